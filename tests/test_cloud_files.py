"""Clouds as files: what we write Open3D reads, what it writes we read, and what is damaged is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navcore import pcd_files, ply_files
from navcore.cloud_files import GREY, read_cloud, write_cloud
from navcore.errors import InputError

COUNT = 500


@pytest.fixture(scope="module")
def cloud() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    # Repeated rows give the compressed form something to compress.
    points = np.repeat(rng.normal(0.0, 5.0, (COUNT // 5, 3)), 5, axis=0).astype(np.float32)
    return points, rng.integers(0, 256, (COUNT, 3)).astype(np.uint8)


@pytest.mark.parametrize("ending", [".ply", ".pcd", ".PLY"])
def test_what_is_written_is_read_back(cloud: tuple[np.ndarray, np.ndarray], tmp_path: Path, ending: str) -> None:
    write_cloud(tmp_path / f"cloud{ending}", *cloud)
    back = read_cloud(tmp_path / f"cloud{ending}")
    np.testing.assert_array_equal(back.points_m, cloud[0])
    np.testing.assert_array_equal(back.colours_rgb, cloud[1])


@pytest.mark.parametrize("ending", [".ply", ".pcd"])
def test_open3d_reads_what_is_written(cloud: tuple[np.ndarray, np.ndarray], tmp_path: Path, ending: str) -> None:
    write_cloud(tmp_path / f"cloud{ending}", *cloud)
    theirs = o3d.io.read_point_cloud(str(tmp_path / f"cloud{ending}"))
    np.testing.assert_allclose(np.asarray(theirs.points), cloud[0], atol=1e-6)
    np.testing.assert_array_equal(np.round(np.asarray(theirs.colors) * 255), cloud[1])


@pytest.mark.parametrize("ascii_text", [True, False])
@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("ending", [".ply", ".pcd"])
def test_what_open3d_writes_is_read(
    cloud: tuple[np.ndarray, np.ndarray], tmp_path: Path, ending: str, ascii_text: bool, compressed: bool
) -> None:
    theirs = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud[0].astype(np.float64)))
    theirs.colors = o3d.utility.Vector3dVector(cloud[1] / 255.0)
    theirs.normals = o3d.utility.Vector3dVector(np.tile([0.0, 0.0, 1.0], (COUNT, 1)))
    path = tmp_path / f"cloud{ending}"
    assert o3d.io.write_point_cloud(str(path), theirs, write_ascii=ascii_text, compressed=compressed)
    back = read_cloud(path)
    np.testing.assert_allclose(back.points_m, cloud[0], atol=1e-4)
    np.testing.assert_allclose(back.colours_rgb.astype(int), cloud[1].astype(int), atol=1)


PLY_VARIANTS = {
    "big endian": (
        b"ply\nformat binary_big_endian 1.0\ncomment made elsewhere\nelement vertex 2\nproperty double x\n"
        b"property double y\nproperty double z\nproperty uint16 red\nproperty uint16 green\nproperty uint16 blue\n"
        b"end_header\n"
        + np.array(
            [(1, 2, 3, 65535, 0, 256), (4, 5, 6, 0, 32768, 0)],
            [(name, ">f8") for name in "xyz"] + [(name, ">u2") for name in "rgb"],
        ).tobytes()
    ),
    "text, faces, brightness from 0 to 1": (
        b"ply\r\nformat ascii 1.0\r\nelement camera 1\r\nproperty float f\r\nelement vertex 2\r\nproperty float z\r\n"
        b"property float x\r\nproperty float y\r\nproperty float red\r\nproperty float green\r\nproperty float blue\r\n"
        b"element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n35.0\r\n"
        b"3 1 2 1 0 0\r\n6 4 5 0 0.5 0\r\n3 0 1 1\r\n"
    ),
}


@pytest.mark.parametrize("name", PLY_VARIANTS)
def test_other_forms_of_ply(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.ply").write_bytes(PLY_VARIANTS[name])
    back = read_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.points_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(back.colours_rgb, [[255, 0, 0], [0, 128, 0]], atol=1)


PCD_HEAD = (
    "VERSION .7\nFIELDS x y z {0}\nSIZE 4 4 4 {1}\nTYPE F F F {2}\nCOUNT 1 1 1 {3}\nWIDTH 3\nHEIGHT 1\nDATA {4}\n"
)


def test_pcd_of_ros_with_padding_and_points_that_are_no_numbers(tmp_path: Path) -> None:
    row = np.dtype([("p", "<f4", 3), ("pad", "<u1", 4), ("rgb", "<u4"), ("pad2", "<u1", 12)])
    rows = np.zeros(3, row)
    rows["p"] = [[1, 2, 3], [np.nan, 0, 0], [4, 5, 6]]
    rows["rgb"] = [0xFF8000, 0, 0x0000FF]
    head = PCD_HEAD.format("_ rgb _", "1 4 1", "U F U", "4 1 12", "binary")
    (tmp_path / "a.pcd").write_bytes(head.encode() + rows.tobytes())
    back = read_cloud(tmp_path / "a.pcd")
    np.testing.assert_array_equal(back.points_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(back.colours_rgb, [[255, 128, 0], [0, 0, 255]])


def test_a_cloud_without_colours_is_grey(tmp_path: Path) -> None:
    text = PCD_HEAD.format("intensity", "4", "F", "1", "ascii") + "1 2 3 0.1\n4 5 6 0.2\n7 8 9 0.3\n"
    (tmp_path / "a.pcd").write_text(text)
    back = read_cloud(tmp_path / "a.pcd")
    assert (back.colours_rgb == GREY).all()
    assert len(back.points_m) == 3


def ply(*lines: str, body: bytes = b"") -> bytes:
    return ("\n".join(["ply", *lines, "end_header"]) + "\n").encode() + body


XYZ = ("property float x", "property float y", "property float z")
BINARY = "format binary_little_endian 1.0"


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.ply", b"", "does not begin like a PLY"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "does not begin like a PLY"),
        ("a.ply", ply("element vertex 1", *XYZ), "text or binary"),
        ("a.ply", ply(BINARY, "element vertex 99999999999999999999", *XYZ), "its header says"),
        ("a.ply", ply(BINARY, "element vertex 40000000", *XYZ, body=b"1234"), "fewer follow"),
        ("a.ply", ply(BINARY, "element vertex -1", *XYZ), "its header says"),
        ("a.ply", ply(BINARY, "element vertex 1", "property string x"), "its header says"),
        ("a.ply", ply(BINARY, "element vertex 1", *XYZ[:2], body=bytes(8)), "no x, y and z"),
        ("a.ply", ply(BINARY, "element face 0"), "no vertices"),
        ("a.ply", ply("format ascii 1.0", "element vertex 1", *XYZ, body=b"1 2 three"), "could not convert"),
        ("a.ply", ply("format ascii 1.0", "element vertex 1", *XYZ, body=b"1 2 9e9"), "100 km"),
        ("a.ply", ply("format ascii 1.0", "element vertex 1", *XYZ, body=b"nan nan nan"), "no points"),
        ("a.pcd", b"VERSION .7\n", "does not begin like a PCD"),
        ("a.pcd", b"FIELDS x y\nDATA ascii\n", "type of each field"),
        ("a.pcd", PCD_HEAD.format("_", "1", "U", "999999999", "binary").encode(), "type that does not exist"),
        ("a.pcd", PCD_HEAD.format("a", "3", "F", "1", "binary").encode(), "type that does not exist"),
        ("a.pcd", PCD_HEAD.format("x", "4", "F", "1", "binary").encode(), "same name"),
        ("a.pcd", PCD_HEAD.format("a", "4", "F", "1", "binary").encode() + bytes(40), "fewer follow"),
        ("a.pcd", PCD_HEAD.format("a", "4", "F", "1", "zipped").encode(), "zipped"),
        (
            "a.pcd",
            PCD_HEAD.format("a", "4", "F", "1", "binary_compressed").encode()
            + np.array([4, 48], "<u4").tobytes()
            + b"\xff\xff\xff\xff",
            "damaged",
        ),
        ("a.xyz", b"1 2 3", "ends in .ply or .pcd"),
    ],
)
def test_a_damaged_cloud_is_refused_with_what_is_wrong(
    tmp_path: Path, name: str, content: bytes, sentence: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=sentence):
        read_cloud(tmp_path / name)


def test_a_file_that_is_not_there_or_cannot_be_written(cloud: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_cloud(tmp_path / "none.ply")
    with pytest.raises(InputError, match="cannot be written"):
        write_cloud(tmp_path / "none" / "a.ply", *cloud)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_no_damage_does_anything_but_be_refused(data: st.DataObject) -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(4, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (4, 3)).astype(np.uint8)
    module = data.draw(st.sampled_from([ply_files, pcd_files]))
    content = bytearray(b"".join(module.encoded(points, colours)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(content)))
    try:
        columns = module.decode(bytes(content[:cut]))
    except (ValueError, OverflowError):
        return
    assert len(columns.x) == len(columns.z)
