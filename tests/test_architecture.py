"""The shape of the house: imports go down, siblings do not know each other, heavy libraries have one door."""

import ast
from pathlib import Path

import pytest

from psflut import family

ROOT = Path(__file__).parent.parent

FLOORS = [  # from the roof to the cellar; a module imports from lower floors only
    {"psflut.cli"},
    {"psflut.cli.shots", "psflut.cli.patchmaps"},
    {"psflut.cli.console", "psflut.cli.options", "psflut.cli.patches"},
    {"psflut.demo", "psflut.gallery", "psflut.reporting", "calib.textures"},
    {"psflut.mapfiles", "psflut.assembly"},
    {"psflut.depthmaps"},
    {"psflut.plots", "calib.gross"},
    {f"psflut.plots.{topic}" for topic in ("comparison", "estimates", "images", "limits", "optics", "tables")},
    {f"psflut.plots.{topic}" for topic in ("depthmaps", "inline", "posteriors", "reports")},
    {"psflut.plots.look"},
    {"psflut.compare", "psflut.findings", "psflut.origins", "psflut.posterior_file"},
    {"psflut.unfinished", "psflut.scoreboard"},
    {"psflut.mapping"},
    {"psflut.cluster", "psflut.workers", "psflut.journal", "psflut.results", "psflut.scores"},
    {"psflut.frames", "psflut.trial"},
    {"psflut.scenes", "psflut.shots", "psflut.photographs"},
    {"calib.calibrate"},
    {"calib.assess"},
    {"calib.check", "calib.drift", "calib.fill", "calib.lens_course", "calib.singles"},
    {"calib.build", "calib.modes", "calib.nearest", "calib.placement", "calib.ranges"},
    {"calib.recipe", "calib.captures"},
    {"calib.planes"},
    {"calib.targets", "calib.manifest", "calib.photons"},
    {"calib.manifest_row", "calib.pupil_fit", "calib.alignment", "calib.noise_target"},
    {"calib.fit_errors"},
    {"calib.radial", "calib.rings", "calib.superresolution", "calib.unfilter", "calib.unfolding"},
    {"calib.registration", "calib.known_scene"},
    {"calib.polar"},
    {"psflut.estimators"},
    {"psflut.batch", "psflut.predictive", "psflut.smoothing"},
    {"psflut.joint", "psflut.jointbound", "psflut.chain", "psflut.budget"},
    {"psflut.fused", "psflut.crossed"},
    {"psflut.pair", "psflut.grid", "psflut.pointfit", "psflut.edgefit", "psflut.limits"},
    {"psflut.candidates", "psflut.gross", "psflut.relief"},
    {"psflut.estimation", "psflut.spread", "psflut.information"},
    {"psflut.ensemble"},
    {"psflut.door"},
    {"psflut.problem", "psflut.summary"},
    {"psflut.edgeshape", "psflut.window"},
    {"psflut.edges"},
    {"psflut.laplace"},
    {"psflut.restore"},
    {"psflut.restore.blind", "psflut.restore.inversion", "psflut.restore.lucy"},
    {"psflut.restore.intake", "psflut.restore.steps"},
    {"psflut.evidence", "psflut.focus", "psflut.density", "psflut.lines", "psflut.covariance"},
    {"psflut.tabulated", "psflut.reblur"},
    {"psflut.texture", "psflut.leakage"},
    {"psflut.spectrum"},
    {"psflut.kernels.exploring"},
    {"psflut.kernels.climbing", "psflut.kernels.curves"},
    {"psflut.kernels.elementary", "psflut.kernels.equations", "psflut.kernels.summing"},
    {"psflut.kernels.algebra", "psflut.kernels.lanes"},
    {"psflut.kernels"},
    {"psflut.capture", "psflut.store"},
    {"psflut.layout"},
    {"psflut.sampling"},
    {"psflut.table"},
    {"psflut.imagers", "psflut.psfs"},
    {"psflut.camera_file"},
    {"psflut.noise", "psflut.optics", "psflut.images", "psflut.writing"},
    {"psflut.container", "psflut.family", "psflut.files", "psflut.tiffs", "psflut.rawfiles", "psflut.videos"},
    {"psflut.units", "psflut.fourier", "psflut.subpixel", "psflut.card", "psflut.tiles"},
    {"psflut.errors"},
    {"psflut", "calib"},
]
DOORS = {
    "zarr": {"psflut.store", "psflut.results", "psflut.frames", "psflut.mapfiles"},
    "emcee": {"psflut.chain"},
    "numba": {"psflut.kernels"},
    "matplotlib": {"psflut.plots"},
    "jinja2": {"psflut.reporting"},
}
LAZY = {"emcee", "matplotlib", "skimage", "imageio", "tifffile", "tqdm", "distributed", "threadpoolctl"}
LAZY |= {"xarray", "h5netcdf", "jinja2"}


def modules():
    for path in sorted([*ROOT.glob("psflut/**/*.py"), *ROOT.glob("calib/**/*.py")]):
        parts = path.relative_to(ROOT).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


MODULES = dict(modules())


def imports(path):
    """(module, whether at module level and at run time) of every import in a file."""
    tree = ast.parse(path.read_text())
    top = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            whole = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in MODULES else node.module for name in whole]
        for name in names:
            yield name, node in top


def floor(module):
    found = [level for level, names in enumerate(FLOORS) if module in names]
    if not found and "." in module:
        return floor(module.rsplit(".", 1)[0])
    assert found, f"{module} stands on no floor: name it in FLOORS"
    return found[0]


@pytest.mark.parametrize("module", MODULES)
def test_imports_go_strictly_down(module):
    for name, _ in imports(MODULES[module]):
        if name.split(".")[0] not in ("psflut", "calib"):
            continue
        own_family = name == module.rpartition(".")[0]
        assert floor(name) > floor(module) or own_family, f"{module} imports {name}"


def test_psflut_asks_calib_in_the_command_line_alone():
    askers = {m for m in MODULES for name, _ in imports(MODULES[m]) if name.startswith("calib") and m[:6] == "psflut"}
    assert {m.rpartition(".")[0] for m in askers} == {"psflut.cli"}


@pytest.mark.parametrize(("library", "doors"), DOORS.items())
def test_heavy_libraries_have_one_door(library, doors):
    users = {m for m in MODULES for name, _ in imports(MODULES[m]) if name.split(".")[0] == library}
    assert {next((door for door in doors if f"{m}.".startswith(f"{door}.")), m) for m in users} == doors


@pytest.mark.parametrize("module", [m for m in MODULES if not m.startswith("psflut.plots")])
def test_heavy_libraries_are_imported_where_they_are_used(module):
    assert not {name for name, top in imports(MODULES[module]) if top and name.split(".")[0] in LAZY}


@pytest.mark.parametrize("module", MODULES)
def test_every_module_says_what_it_is(module):
    assert ast.get_docstring(ast.parse(MODULES[module].read_text()))


def test_the_control_a_sibling_import_is_seen():
    assert floor("psflut.estimators.wiener") == floor("psflut.estimators.posterior")
    assert set(family.names("psflut.estimators")) <= {m.rsplit(".", 1)[-1] for m in MODULES}
