"""What is known of a number that is between two others. Knows no metric."""

from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True, kw_only=True)
class Interval:
    """``lower <= value <= upper``, in one unit for all that are compared.

    Parameters
    ----------
    lower, upper : float
        The bounds.
    """

    lower: float
    upper: float

    def scaled(self, factor: float) -> "Interval":
        """Of the value times a positive factor."""
        return Interval(lower=self.lower * factor, upper=self.upper * factor)
