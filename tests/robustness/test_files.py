"""Files and folders are written whole or not at all."""

import os

import pytest

from swarm._support.files import new_folder, replacing, write_bytes, write_text


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "file.txt"
    write_text(path, "κ₁")
    write_bytes(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_on_the_way_leaves_what_was_there(tmp_path):
    path = tmp_path / "file.txt"
    write_text(path, "old")

    def half():
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_nobody_sees_a_folder_before_it_is_full(tmp_path):
    target = tmp_path / "deep" / "results"
    with new_folder(target) as folder:
        (folder / "a").write_text("a")
        assert not target.exists()
    assert [file.name for file in target.iterdir()] == ["a"]
    assert list(target.parent.iterdir()) == [target]


def test_an_empty_folder_is_filled(tmp_path):
    with new_folder(tmp_path / "results") as folder:
        (folder / "a").write_text("a")
    (tmp_path / "empty").mkdir()
    with new_folder(tmp_path / "empty") as folder:
        (folder / "b").write_text("b")
    assert (tmp_path / "empty" / "b").exists()


def test_an_error_on_the_way_leaves_no_folder(tmp_path):
    def half():
        with new_folder(tmp_path / "results") as folder:
            (folder / "a").write_text("a")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        half()
    assert list(tmp_path.iterdir()) == []


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


def test_a_file_that_comes_up_meanwhile_is_not_overwritten(tmp_path):
    target = tmp_path / "results"

    def collide():
        with new_folder(target) as folder:
            (folder / "a").write_text("a")
            target.mkdir()
            (target / "precious").write_text("1")

    with pytest.raises(OSError, match="results"):
        collide()
    assert [file.name for file in target.iterdir()] == ["precious"]
    assert list(tmp_path.iterdir()) == [target]
