"""A library of version 0.1 (commit 13dca06: `generate --policy swerve --cases 12 --seed 3`), refused and migrated.

What else earlier versions wrote is made here of present files by taking away what they lacked.
"""

from __future__ import annotations

import json
import os
import shutil
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from artefacts import artefact
from edited_files import rewrite_shard
from safetensors.numpy import save_file

import cornerforge
from cornerforge._checksums import read_json, read_tensors
from cornerforge.errors import FileFormatError, InputError, OutputError
from cornerforge.experiment.av_file import load_av, rl_av_path
from cornerforge.fields import BODY
from cornerforge.library import CaseLibrary
from cornerforge.ndd.memory import Memory
from cornerforge.ndd.model import default_model_path, load_model
from cornerforge.sim import scripted

OLD = Path(__file__).parent / "version_0_1"
FIRST = "38632621c336e1c28a02d0323240a728d8eda9e0e6df9e00f388ca32f2b1d819"
"""Digest of its first case, as version 0.1 printed it."""
ADVICE = "cornerforge migrate OLD --out NEW"


def test_a_library_of_version_0_1_is_refused_and_migrated(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=rf"manifest\.json carries no checksum.*{ADVICE}"):
        CaseLibrary.open(OLD)
    found = cornerforge.migrate(OLD, out=tmp_path / "new")
    assert (found.cases, found.made_by) == (12, "0.1.0")
    said = json.loads((OLD / "manifest.json").read_text(encoding="utf-8"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        new = CaseLibrary.open(tmp_path / "new")
        assert new.verify() == []
        assert cornerforge.verify(tmp_path / "new").without_checksum == ()
    assert (new.identity, new.tests, new.crashes, new.finished) == (
        said["run"], said["tests"], said["crashes"], said["finished"],
    )  # fmt: skip
    first = new.scenario("3:0")
    assert first.scalars["trajectory_digest"] == FIRST
    assert (first.scalars["bv_kind"], first.scalars["bv_length_m"]) == (0, 5.0)
    assert set(first.scenario.length) == {5.0}
    tracks = pq.read_table(OLD / "tracks-000000.parquet")
    np.testing.assert_array_equal(first.scenario.x.T.ravel(), np.array(tracks["x_m"][0].as_py(), np.float32))
    assert read_json(tmp_path / "new" / "provenance.json", "")["made_by"] == "0.1.0"
    assert cornerforge.query(tmp_path / "new", "select count(*) from cases where bv_kind = 0").rows == ((12,),)


def test_a_damaged_one_is_not_migrated(tmp_path: Path) -> None:
    shutil.copytree(OLD, tmp_path / "old")
    content = bytearray((tmp_path / "old" / "tracks-000000.parquet").read_bytes())
    content[5000] ^= 1
    (tmp_path / "old" / "tracks-000000.parquet").write_bytes(content)
    with (
        pytest.warns(UserWarning, match="has been changed"),
        pytest.raises(FileFormatError, match=r"tracks-000000\.parquet has been changed"),
    ):
        cornerforge.migrate(tmp_path / "old", out=tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("kind", "lacking"),
    [
        ("tracks", ["change_time_s"]),
        ("tracks", [one.column.name for one in BODY]),
        ("cases", ["possible_shortfall_nats", "n_implausible"]),
        ("cases", ["bv_kind", "bv_length_m", "bv_width_m"]),
    ],
)
def test_columns_that_came_later_are_filled_in(filled: Path, tmp_path: Path, kind: str, lacking: list[str]) -> None:
    rewrite_shard(filled, 1, kind, lambda table: table.drop_columns(lacking))
    with pytest.raises(FileFormatError, match=rf"{kind}-000001\.parquet .*{min(lacking)}.*{ADVICE}"):
        list(CaseLibrary.open(filled).shards())
    assert cornerforge.migrate(filled, out=tmp_path / "new").cases == 6
    assert CaseLibrary.open(tmp_path / "new").verify() == []


@pytest.mark.full
@pytest.mark.parametrize("lacking", [2, 4, 5, len(scripted.TRAITS), len(scripted.TRAITS) + 3])
def test_drivers_of_older_starts_desire_the_speed_that_they_have(tmp_path: Path, lacking: int) -> None:
    """Stored before drivers looked away, before lane changes had times, before memory, and before there were trucks."""
    shutil.copytree(artefact("case-file") / "imported" / "library", tmp_path / "old")

    def cut(table: pa.Table) -> pa.Table:
        fields = len(scripted.START_FIELDS)
        rows = [np.reshape(row, (-1, fields))[:, :-lacking].ravel() for row in table["start"].to_pylist()]
        place = table.column_names.index("start")
        return table.set_column(place, table.field(place), pa.array(rows, table.field(place).type))

    rewrite_shard(tmp_path / "old", 0, "tracks", cut)
    old = CaseLibrary.open(tmp_path / "old")
    [name] = old.scalars(["case_id"])["case_id"].to_pylist()
    with pytest.raises(FileFormatError, match=f"has a start of an earlier version.*{ADVICE}"):
        old.scenario(name)
    cornerforge.migrate(tmp_path / "old", out=tmp_path / "new")
    case = CaseLibrary.open(tmp_path / "new").scenario(name)
    assert case.script is not None
    start = case.script.start
    assert set(start["noise"]) == {0.0}
    assert set(start["inattention"]) == {1.0}
    assert set(start["away"]) == {0}
    if lacking > 5:
        np.testing.assert_array_equal(start["desired_speed"], start["speed"])
        np.testing.assert_array_equal(start["quantile"], 0.5)
    if lacking > 4:
        np.testing.assert_array_equal(start["change_time"], case.scenario.odd.lane_change_duration)
    np.testing.assert_array_equal(start["length"], case.scenario.length)


def test_models_weights_and_tables_of_a_folder_get_their_checksums(tmp_path: Path) -> None:
    old = tmp_path / "old"
    (old / "stages").mkdir(parents=True)
    with np.load(default_model_path()) as file:
        arrays = {name: file[name] for name in file.files if name not in ("checksums", "lc_turn_back")}
    header = json.loads(str(arrays["header"])) | {"schema_version": 1}
    del header["memory"], header["free_pull"]
    np.savez(old / "model.npz", **(arrays | {"header": np.array(json.dumps(header))}))
    header, weights = read_tensors(rl_av_path(), "cornerforge_av", "AV")
    save_file(weights, old / "av.safetensors", metadata={"cornerforge_av": json.dumps(header)})
    (old / "stages" / "nde.json").write_text('{"tests": 3}', encoding="utf-8")
    (old / "case.json").write_text('{"format": "cornerforge case"}', encoding="utf-8")
    pq.write_table(pa.table({"case_id": ["1:2"]}), old / "points.parquet")
    (old / "report.html").write_text("<p>", encoding="utf-8")
    for refused_by, name in ((load_model, "model.npz"), (load_av, "av.safetensors")):
        with pytest.raises(FileFormatError, match=ADVICE):
            refused_by(old / name)
    assert cornerforge.migrate(old, out=tmp_path / "new").cases == 0
    model = load_model(tmp_path / "new" / "model.npz")
    assert (model.memory, model.free_pull) == (Memory(), 0.0)
    refused = np.minimum(model.lc_accept_lead, model.lc_accept_rear) == 0.0
    np.testing.assert_array_equal(model.lc_turn_back, refused)
    assert read_json(tmp_path / "new" / "stages" / "nde.json", "") == {"tests": 3}
    assert (tmp_path / "new" / "case.json").read_bytes() == (old / "case.json").read_bytes()
    assert (tmp_path / "new" / "report.html").is_file()
    found = cornerforge.verify(tmp_path / "new")
    assert [Path(one).name for one in found.without_checksum] == ["case.json"]
    network = load_av(tmp_path / "new" / "av.safetensors").network
    assert network is not None
    np.testing.assert_array_equal(network.weights, weights["weights"])
    cornerforge.migrate(old / "model.npz", out=tmp_path / "one.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "new" / "model.npz").read_bytes()


def test_places_that_cannot_be_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing at"):
        cornerforge.migrate(tmp_path / "none", out=tmp_path / "new")
    (tmp_path / "old").mkdir()
    with pytest.raises(InputError, match="copied into itself"):
        cornerforge.migrate(tmp_path / "old", out=tmp_path / "old" / "new")
    (tmp_path / "new").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="there already"):
        cornerforge.migrate(tmp_path / "old", out=tmp_path / "new")
    assert (tmp_path / "new").read_text(encoding="utf-8") == "mine"
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "leads-nowhere").symlink_to(tmp_path / "none")
    for name in ("pipe", "leads-nowhere"):
        with pytest.raises(OutputError, match="there already"):
            cornerforge.migrate(OLD / "manifest.json", out=tmp_path / name)
    for leads_to in ("..", "../new"):
        (tmp_path / "old" / "link").unlink(missing_ok=True)
        (tmp_path / "old" / "link").symlink_to(leads_to)
        with pytest.raises(InputError, match="link is a link"):
            cornerforge.migrate(tmp_path / "old", out=tmp_path / "other")
    assert not (tmp_path / "other").exists()
