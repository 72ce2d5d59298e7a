"""A sampled posterior as a file that ArviZ opens: a folder ``x.zarr`` or a netCDF file ``x.nc``.

Groups and names are those of ArviZ' schema (InferenceData up to 0.23, DataTree from 1.0): ``posterior`` and
``sample_stats`` over (chain, draw), a walker being a chain; ``posterior_predictive``, ``observed_data`` and
``constant_data`` over the annuli of the patch's spectrum. Lengths are metres.

ArviZ opens ``x.nc`` by ``from_netcdf`` and ``x.zarr`` by ``from_zarr``; ArviZ 0.23 refuses Zarr of version 3 and names
the way: ``InferenceData.from_datatree(xarray.open_datatree("x.zarr", engine="zarr"))``.
"""

import json
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut import __version__
from psflut.errors import PsflutError
from psflut.estimation import Estimate
from psflut.files import refuse_overwrite, staged
from psflut.texture import WAVES

WALK = ("chain", "draw")
ANNULI = ("frequency",)
UNITS = {"distance": "m", "vergence": "1/m", "stage": "m"}
LONG_NAMES = {
    "distance": "distance, with the table's own errors",
    "vergence": "1 / distance, as the table has it",
    "stage": "stage coordinate, as the table has it",
    "theta": "coefficients of the log spectrum of the scene",
    "alpha": "of its share that goes with the cosine of twice the direction",
    "beta": "of its share that goes with the sine of twice the direction",
    "gamma": "of its share that goes with the cosine of four times the direction",
    "ln_sigma": "ln of the noise beside its estimate",
    "lp": "log posterior density, up to a constant",
    "power": "power of the patch in each annulus, full scale squared",
    "noise": "mean power of the noise",
    "shape": "shape of the gamma distribution of the power",
}


def check_posterior(path: Path, overwrite: bool) -> None:
    """Refuse, before the work, a path that `write_posterior` would refuse after it, or libraries that it lacks."""
    if path.suffix not in (".zarr", ".nc"):
        raise PsflutError(f"a posterior is kept in a folder NAME.zarr or a file NAME.nc, got {path.name}; choose one")
    refuse_overwrite(path, overwrite)
    _xarray(path)


def write_posterior(
    found: Estimate, path: Path, about: Mapping[str, Any] | None = None, overwrite: bool = False
) -> None:
    """Keep the chain of an estimate by `posterior`, whole or not at all.

    Parameters
    ----------
    found : Estimate
    path : Path
        Ends in .zarr or .nc.
    about : mapping or None
        Where patch and table come from; plain JSON, kept in the attribute ``about``.

    Raises
    ------
    PsflutError
        If the estimate has no chain, xarray (or for .nc h5netcdf) is missing, or the path cannot be written.
    """
    check_posterior(path, overwrite)
    if "chain" not in found.detail:
        raise PsflutError(f"there is no chain to keep in {path.name}: the outcome is {found.outcome.name.lower()}")
    xarray = _xarray(path)
    groups = {name: xarray.Dataset(*parts) for name, parts in _groups(found).items()}
    tree = xarray.DataTree.from_dict({"/": xarray.Dataset(attrs=_attributes(found, about)), **groups})
    with staged(path, overwrite) as stage:
        if path.suffix == ".zarr":
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore"
                )  # zarr says that consolidated metadata are no standard; xarray wants them
                tree.to_zarr(stage, mode="w-", zarr_format=3)
        else:
            tree.to_netcdf(stage, engine="h5netcdf")


def _groups(found: Estimate) -> dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]]:
    """(variables, coordinates, attributes) of every group."""
    chain, names, seen = found.detail["chain"], found.detail["names"], found.detail["prediction"]
    steps, walkers, _ = chain.shape
    walk = {"chain": np.arange(walkers), "draw": np.arange(steps)}
    annuli = {"frequency": ("frequency", seen.frequency, {"units": "1/pixel"})}
    posterior = {
        "distance": _variable("distance", WALK, found.detail["distances"].reshape(steps, walkers).T),
        names[0]: _variable(names[0], WALK, chain[:, :, 0].T),
    }
    coordinates: dict[str, Any] = {**walk}
    for wave in WAVES:
        own = [name.startswith(f"{wave}_") for name in names]
        if any(own):
            number = "coefficient" if wave == "theta" else "turn"
            posterior[wave] = _variable(wave, (*WALK, number), chain[:, :, own].swapaxes(0, 1))
            coordinates[number] = np.arange(sum(own))
    if names[-1] == "ln_sigma":
        posterior["ln_sigma"] = _variable("ln_sigma", WALK, chain[:, :, -1].T)
    made = {"inference_library": "emcee", "inference_library_version": version("emcee")}
    observed, constant = {"power": seen.power}, {"noise": seen.noise, "shape": seen.shape}
    replicas = {"chain": [0], "draw": np.arange(len(seen.replicated)), **annuli}
    return {
        "posterior": (posterior, coordinates, made),
        "sample_stats": ({"lp": _variable("lp", WALK, found.detail["log_probability"].T)}, walk, made),
        "posterior_predictive": ({"power": _variable("power", (*WALK, *ANNULI), seen.replicated[None])}, replicas, {}),
        "observed_data": ({name: _variable(name, ANNULI, values) for name, values in observed.items()}, annuli, {}),
        "constant_data": ({name: _variable(name, ANNULI, values) for name, values in constant.items()}, annuli, {}),
    }


def _variable(
    name: str, dimensions: tuple[str, ...], values: NDArray[Any]
) -> tuple[tuple[str, ...], NDArray[Any], dict[str, str]]:
    units = {"units": UNITS[name]} if name in UNITS else {}
    return dimensions, np.ascontiguousarray(values), {"long_name": LONG_NAMES[name], **units}


def _attributes(found: Estimate, about: Mapping[str, Any] | None) -> dict[str, Any]:
    """What netCDF can hold: numbers, and text, of which the last two are JSON."""
    return {
        "psflut": __version__,
        "distance_m": found.distance,
        "interval_m": list(found.interval),
        "level": found.level,
        "outcome": found.outcome.name.lower(),
        "stats": json.dumps({name: value for name, value in found.stats.items() if name != "seconds"}),
        "about": json.dumps(dict(about or {})),
    }


def _xarray(path: Path) -> Any:
    try:
        import xarray

        if path.suffix == ".nc":
            import h5netcdf  # noqa: F401
            import h5py  # noqa: F401  (which h5netcdf does not bring along)
    except ImportError as error:
        raise PsflutError(f"{path.name} needs {error.name}; install it with: pip install psflut[lab]") from error
    return xarray
