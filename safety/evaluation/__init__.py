"""Evaluation: the judge feeds the oracles of a run; its log can be judged again."""
