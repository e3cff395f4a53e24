"""The model: samples that are judged, results of oracles, the verdict of a run."""
