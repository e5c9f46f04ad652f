"""The error of metrics, which several modules of them raise."""


class MetricError(ValueError):
    """A metric that a run cannot give; the message is one sentence: metric or run, what is wrong, remedy."""
