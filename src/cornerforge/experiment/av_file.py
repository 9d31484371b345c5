"""Files of learned AVs: a network and what it was trained for, in safetensors (no pickle, no PyTorch needed)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from msgspec import structs

from cornerforge._checksums import read_tensors, weights_of, write_tensors
from cornerforge._schema import Closed, Whole, meant, read
from cornerforge._words import shown
from cornerforge.drivers.avs import AVS, AvModel, AvNetwork, av_named
from cornerforge.drivers.policy import LEARNED_WIDTH, NetworkShape, n_weights
from cornerforge.drivers.sight import Sight
from cornerforge.errors import FileFormatError, InputError
from cornerforge.foreign.spec import AvSpec
from cornerforge.sim import av_features

__all__ = ["AV_FILE_SCHEMA", "RECORDED_AV", "AvHeader", "av_of", "load_av", "rl_av_path", "save_av"]

RECORDED_AV = "recorded"
"""Name of the AV of cases on rails in which whatever was in its seat moves as it was recorded."""
AV_FILE_SCHEMA = 1
_KEY = "cornerforge_av"
_SIGHTS = {1: Sight("decision"), av_features.AV_FEATURES_VERSION: Sight()}
"""What an AV sees of lane changes, by the version of the features on which it learned."""


class AvHeader(Closed, frozen=True):
    """Header of a learned AV; the weights are the array `weights`, float32."""

    schema_version: Annotated[Whole, meant("Version of the file.")]
    features_version: Annotated[Whole, meant("Version of the features on which it learned.")]
    network: Annotated[NetworkShape, meant("Its shape: n_inputs, n_shared, n_stream and width.")]
    about: Annotated[
        dict[str, Any], meant("How it was trained: free text and numbers; `about` in it is shown by `avs`.")
    ]


def rl_av_path() -> Path:
    """Return the path of the learned AV that ships with the package."""
    return Path(__file__).parent.parent / "drivers" / "rl_av.safetensors"


def av_of(name: str) -> AvModel:
    """Return a built-in AV by its name, or a learned AV by its file (`.safetensors`), ready to drive.

    For an AV from outside, and for RECORDED_AV, it is idm-mobil under their name: tests start with its desired gaps.

    Raises:
        UnknownNameError: There is no built-in AV of that name.
        InputError: It is a Python file without a class.
        FileFormatError: The file is missing, damaged, or no learned AV of this version.
    """
    if name.endswith(".py") and not AvSpec(name).is_outside:
        raise InputError(f"{shown(name)} is a file; name the class in it too, such as {shown(f'{name}:MyAv')}.")
    if name.endswith(".safetensors"):
        return load_av(Path(name))
    if AvSpec(name).is_outside or name == RECORDED_AV:
        return replace(av_named("idm-mobil"), name=name)
    model = av_named(name)
    return replace(load_av(rl_av_path()), name=name, about=model.about) if model.kind == "learned" else model


def save_av(network: AvNetwork, about: Mapping[str, Any], path: Path) -> None:
    """Write a learned AV whole, or not at all.

    Args:
        network: Its network.
        about: How the AV was trained, JSON-compatible.
        path: The file to write.

    Raises:
        OutputError: It cannot be written.
    """
    header = {
        "schema_version": AV_FILE_SCHEMA,
        "features_version": network.features_version,
        "network": structs.asdict(network.shape),
        "about": dict(about),
    }
    write_tensors(path, _KEY, header, {"weights": network.weights}, "the AV")


def load_av(path: Path) -> AvModel:
    """Read a learned AV; its name is the path, its IDM and MOBIL parameters are the ones of `rl`.

    Raises:
        FileFormatError: Missing, damaged, no learned AV, of another schema, or made for another observation.
    """
    if not path.is_file():
        raise FileFormatError(f"No AV file {path}; make one with: cornerforge train-av --out {path}")
    header, tensors = read_tensors(path, _KEY, "learned AV")
    told = read(AvHeader, header, f"AV file {path} is damaged")
    _check_versions(told, path)
    shape = told.network
    if shape.n_inputs != av_features.N_AV_FEATURES or shape.width > LEARNED_WIDTH:
        raise FileFormatError(f"AV file {path} is damaged: its network does not fit what an AV sees.")
    weights = weights_of(path, tensors, n_weights(shape), "learned AV")
    about, version = told.about.get("about", "a learned AV"), told.features_version
    network = AvNetwork(shape, weights, version)
    return replace(AVS["rl"], name=str(path), about=str(about), network=network, sight=_SIGHTS[version])


def _check_versions(told: AvHeader, path: Path) -> None:
    """Refuse files of other versions by name.

    Raises:
        FileFormatError: The file is of another schema or for another observation.
    """
    for key, ours in (("schema_version", (AV_FILE_SCHEMA,)), ("features_version", tuple(_SIGHTS))):
        if (version := getattr(told, key)) not in ours:
            raise FileFormatError(
                f"AV file {path} has {key} {version}; this cornerforge reads {' and '.join(map(str, ours))}. "
                f"Train it again: cornerforge train-av --out {path}"
            )
