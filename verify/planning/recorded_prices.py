"""Prices of savings as they were measured and recorded beside a case's baseline; the plan reads them."""

import pandas as pd

from cases import Case, UserError
from verify.planning.savings import Saving, savings


class PricesError(UserError):
    """Recorded prices cannot be read."""


PRICES_FILE = "prices.csv"
PRICE_COLUMNS = (
    "tier", "run", "saving", "seconds_with", "seconds_without", "work_with", "work_without", "unknowns_with",
    "unknowns_without", "quantity", "with", "without", "unit", "change", "status", "version", "stated_hash",
)  # fmt: skip


def read_prices(case: Case) -> pd.DataFrame:
    """All recorded prices of a case, of every tier; empty without any.

    Raises
    ------
    PricesError : the file is damaged.
    """
    file = case.kept_folder / PRICES_FILE
    if not file.is_file():
        return pd.DataFrame(columns=list(PRICE_COLUMNS))
    try:
        table = pd.read_csv(file)
    except ValueError as error:
        raise PricesError(f"{file}: is no readable table ({error}); restore it or delete it.") from error
    if tuple(table.columns) != PRICE_COLUMNS:
        raise PricesError(f"{file}: its columns must be {','.join(PRICE_COLUMNS)}; restore it or delete it.")
    return table


def current_prices(case: Case, run: str) -> pd.DataFrame:
    """Recorded prices of a run's savings, of its case as it stands.

    case : with the run's changes merged in
    """
    prices = read_prices(case)
    mine = (prices["tier"] == case.tier) & (prices["run"] == run) & (prices["stated_hash"] == case.hash(stated=True))
    return prices[mine]


def costs_of_savings(case: Case, run: str) -> dict[str, float]:
    """Largest change of a checked quantity that each saving in use costs; not a number where that was not priced."""
    prices = current_prices(case, run)
    used = [saving.name for saving in savings(case) if saving.off]
    return {name: float(prices.loc[prices["saving"] == name, "change"].abs().max()) for name in used}


def chosen_savings(case: Case, run: str, accuracy: float) -> tuple[tuple[Saving, ...], tuple[str, ...]]:
    """The savings of a run's case that are too dear for an accuracy, and why, one reason each.

    case : with the run's changes merged in. Errors can add up: the dearest are left out until the recorded prices of
    the others together are within the accuracy; savings that were not priced count for nothing.
    """
    used = {saving.name: saving for saving in savings(case) if saving.off}
    left = {name: cost for name, cost in costs_of_savings(case, run).items() if cost > 0.0}
    dear, reasons = [], []
    while (together := sum(left.values())) > accuracy:
        name = max(left, key=lambda name: left[name])
        dear.append(used[name])
        own, all_ = f"{100 * left.pop(name):.2g} %", f"{100 * together:.2g} %"
        others = f", {all_} with the others" if all_ != own else ""
        reasons.append(f"costs {own}{others}, of {100 * accuracy:.2g} % wanted")
    return tuple(dear), tuple(reasons)
