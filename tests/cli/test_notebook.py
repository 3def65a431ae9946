"""A notebook as users have it: cards and figures show by themselves, without magics."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

QUICKSTART = Path(__file__).parents[2] / "sample_data/quickstart"

CELLS = (
    "from tgospa_eval import Recorder, evaluate\n"
    f"truth, estimate = (r'{QUICKSTART}/' + name for name in ('truth.csv', 'estimate.csv'))",
    "result = evaluate(truth, estimate, cutoff=10, switch_penalty=5, unit='m')\nresult",
    "result.plot_costs()",
    "result.per_step.head(2)",
    "figure = result.plot_lanes()",
    "evaluate(truth, 'no such file.csv', cutoff=10, switch_penalty=5)",
)


@pytest.mark.process
def test_a_notebook_shows_results_and_figures(tmp_path: Path) -> None:
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
    notebook.metadata.kernelspec = {"name": "python3", "display_name": "", "language": "python"}
    client = NotebookClient(notebook, timeout=120, allow_errors=True)
    client.execute(cwd=str(tmp_path))
    outputs = [cell.outputs for cell in notebook.cells]

    card, figure, table = (
        next(each.data for each in outputs[k] if each.output_type == "execute_result")
        for k in (1, 2, 3)
    )
    assert "42.5352 m" in card["text/html"]
    assert figure["image/png"].startswith("iVBOR")  # the signature of PNG
    assert "<table" in table["text/html"]
    assert outputs[4] == []  # nothing shows twice
    (error,) = (each for each in outputs[5] if each.output_type == "error")
    assert error.ename == "InputError"
    assert "no such file.csv" in error.evalue
    assert list(tmp_path.iterdir()) == []
