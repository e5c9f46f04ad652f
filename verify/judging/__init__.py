"""Finished runs held against targets: verdicts, baselines and the summary."""
