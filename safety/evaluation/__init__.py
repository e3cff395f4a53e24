"""Evaluation: the judge of a run feeds its oracles; its log can be judged again."""
