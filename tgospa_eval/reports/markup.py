"""Small tables for papers and pull requests: Markdown and LaTeX."""

from tgospa_eval.common.figures import number
from tgospa_eval.reports import escape
from tgospa_eval.reports.console import headline
from tgospa_eval.results.records import PARTS
from tgospa_eval.results.summary import Summary


def _rows(result: Summary) -> list[tuple[str, str, str, str]]:
    costs: dict[str, float] = {name: getattr(result, name) for name in PARTS}
    if result.split is not None:
        means, spread = result.split
        halves = {"of which means": means, "of which spread": spread}
        costs = {"localisation": costs.pop("localisation"), **halves, **costs}
    rows: list[tuple[str, str, str, str]] = []
    for name, cost in costs.items():
        count = number(result.counts[name]) if name in result.counts else ""
        share = f"{100 * cost / result.total:.1f}" if result.total > 0 else ""
        rows.append((name, number(cost), share, count))
    rows.append(("total", number(result.total), "100" if result.total > 0 else "", ""))
    return rows


def _parameters(result: Summary) -> str:
    p = result.proof.parameters
    return f"c = {p.cutoff:g}, p = {p.order:g}, gamma = {p.switch_penalty:g}"


def markdown(result: Summary) -> str:
    """A Markdown table with the headline above it."""
    title = escape.markdown(headline(result))
    lines = [f"**{title}** ({_parameters(result)})", "", "| cost | | share % | count |"]
    lines.append("|---|---:|---:|---:|")
    lines += [f"| {' | '.join(row)} |" for row in _rows(result)]
    for notice in result.warnings:
        lines += ["", f"> {escape.markdown(str(notice))}"]
    return "\n".join(lines) + "\n"


def latex(result: Summary) -> str:
    """A booktabs table with a comment that says how the number was proven."""
    lines = [
        escape.latex_comment(f"{headline(result)} ({_parameters(result)})"),
        *(escape.latex_comment(str(notice)) for notice in result.warnings),
        r"\begin{tabular}{lrrr}",
        r"\toprule",
        r"cost & & share (\%) & count \\",
        r"\midrule",
    ]
    lines += [f"{' & '.join(row)} \\\\" for row in _rows(result)[:-1]]
    lines += [r"\midrule", f"{' & '.join(_rows(result)[-1])} \\\\"]
    lines += [r"\midrule", f"TGOSPA & {number(result.tgospa)} & & \\\\", r"\bottomrule"]
    lines.append(r"\end{tabular}")
    return "\n".join(lines) + "\n"
