"""Files and folders are written whole or not at all."""

import contextlib
import os

import pytest

from swarm._support.files import new_folder, replacing, write_bytes, write_text


def test_a_file_is_replaced_or_stays_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "file.txt"
    write_text(path, "κ₁")
    write_bytes(path, b"old")
    with contextlib.suppress(KeyboardInterrupt), replacing(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("empty", [False, True])
def test_nobody_sees_a_folder_before_it_is_full(tmp_path, empty):
    target = tmp_path / "deep" / "results"
    if empty:
        target.mkdir(parents=True)
    with contextlib.suppress(OSError), new_folder(target) as folder:
        (folder / "a").write_text("a")
        raise OSError("disk full")
    assert list(tmp_path.glob("deep/*")) == [target] * empty
    with new_folder(target) as folder:
        (folder / "a").write_text("a")
        assert [*tmp_path.glob("deep/results/*")] == []
    assert [file.name for file in target.iterdir()] == ["a"]
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("kind", ["folder", "file", "link"])
def test_what_is_there_is_refused_by_name(tmp_path, kind):
    path = tmp_path / "results"
    if kind == "folder":
        path.mkdir()
        (path / "precious").write_text("1")
    elif kind == "file":
        path.write_text("1")
    else:
        os.symlink(tmp_path / "nowhere", path)
    with pytest.raises(FileExistsError, match=f"{path} must be a new or an empty folder"), new_folder(path):
        pass
    assert path.is_symlink() or path.exists()
