"""Notebooks run from their scripts, and the paired .ipynb tells the same story."""

from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.py"))


@pytest.mark.parametrize("size", ["small", pytest.param("full", marks=pytest.mark.benchmark)])
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
# The kernel's own client libraries leave sockets to the collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs(script, size, monkeypatch):
    import jupytext
    from nbclient import NotebookClient

    monkeypatch.setenv("PSFLUT_NOTEBOOKS", size)
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
