"""Notebooks run from their scripts, and the paired .ipynb tells the same story."""

import ast
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.py"))


def shown(source, names):
    """Run a cell; the picture of its last expression, if it has one."""
    tree = ast.parse(source)
    last = ast.Expression(tree.body.pop().value) if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), names)
    value = eval(compile(last, "<cell>", "eval"), names) if last else None
    return value._repr_png_() if hasattr(value, "_repr_png_") else None


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_runs(script, monkeypatch, capfd):
    """On small settings, in this process: four kernels would take as long to start as the cells to run."""
    import jupytext

    monkeypatch.setenv("PSFLUT_NOTEBOOKS", "small")
    names = {"__name__": "__main__"}
    cells = [cell for cell in jupytext.read(script).cells if cell.cell_type == "code"]
    pictures = [shown(cell.source, names) for cell in cells]
    assert sum(bool(picture) for picture in pictures) >= 3
    assert not capfd.readouterr().err


@pytest.mark.benchmark
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
# The kernel's own client libraries leave sockets to the collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs_at_full_size(script):
    """In a kernel of its own."""
    import jupytext
    from nbclient import NotebookClient

    notebook = jupytext.read(script)
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in outputs) >= 3
    assert "stderr" not in {output.get("name") for output in outputs}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_is_paired_with_its_script(script):
    import jupytext

    paired, source = jupytext.read(script.with_suffix(".ipynb")), jupytext.read(script)
    assert [cell.source for cell in paired.cells] == [cell.source for cell in source.cells]
