"""Files appear whole or not at all, files that belong together too, and a symbolic link stays one."""

import os

import pytest

from lcpimpact.errors import InputError
from lcpimpact.files import check_output, whole_file, whole_files

linked = pytest.mark.skipif(os.name == "nt", reason="symbolic links need a right on Windows")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@linked
def test_a_symbolic_link_stays_and_the_file_that_it_points_to_is_written(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    (there / "run.csv").write_text("older")
    (here / "middle.csv").symlink_to("../there/run.csv")
    (here / "link.csv").symlink_to("middle.csv")
    with whole_file(here / "link.csv") as part:
        assert part.parent == there.resolve(), "or the rename would cross file systems"
        part.write_text("newer")
        assert (there / "run.csv").read_text() == "older"
    assert (there / "run.csv").read_text() == "newer"
    assert (here / "link.csv").readlink().name == "middle.csv"
    assert (here / "middle.csv").is_symlink()
    assert names(there) == ["run.csv"]


@linked
def test_a_link_to_a_file_that_is_not_there_yet_makes_it(tmp_path):
    (tmp_path / "link.csv").symlink_to(tmp_path / "run.csv")
    with whole_file(tmp_path / "link.csv") as part:
        part.write_text("new")
    assert (tmp_path / "run.csv").read_text() == "new"
    assert (tmp_path / "link.csv").is_symlink()


@linked
def test_links_that_lead_nowhere_are_refused_before_any_work(tmp_path):
    (tmp_path / "lost.csv").symlink_to(tmp_path / "nowhere" / "run.csv")
    with pytest.raises(InputError, match=r"cannot write .*lost\.csv': there is no folder .*nowhere"):
        check_output(tmp_path / "lost.csv", [".csv"])
    (tmp_path / "a.csv").symlink_to(tmp_path / "b.csv")
    (tmp_path / "b.csv").symlink_to(tmp_path / "a.csv")
    with pytest.raises(InputError, match=r"cannot write .*a\.csv': it is a link to itself; name another"):
        check_output(tmp_path / "a.csv", [".csv"])
    assert names(tmp_path) == ["a.csv", "b.csv", "lost.csv"]


def test_files_that_belong_together_are_all_replaced(tmp_path):
    paths = [tmp_path / "a.txt", tmp_path / "b.txt"]
    paths[0].write_text("older a")
    with whole_files(*paths) as parts:
        for part, text in zip(parts, "ab", strict=True):
            part.write_text(text)
        assert paths[0].read_text() == "older a"
        assert not paths[1].exists()
    assert [path.read_text() for path in paths] == ["a", "b"]
    assert names(tmp_path) == ["a.txt", "b.txt"]


@pytest.mark.parametrize("before", ["older", None])
def test_if_one_of_them_cannot_be_replaced_none_is(tmp_path, before):
    """A folder stands where the second file belongs, which shows only when it is renamed."""
    a, b = tmp_path / "a.txt", tmp_path / "b.txt"
    if before:
        a.write_text(before)
    b.mkdir()
    with pytest.raises(InputError, match="nothing was changed"), whole_files(a, b) as parts:
        [part.write_text("newer") for part in parts]
    assert (a.read_text() if a.exists() else None) == before
    assert names(tmp_path) == (["a.txt", "b.txt"] if before else ["b.txt"])


def test_a_writer_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_files(tmp_path / "a.txt", tmp_path / "b.txt"):
        _ = 1 / 0
    with pytest.raises(InputError, match="nowhere"), whole_files(tmp_path / "a.txt", tmp_path / "nowhere" / "b.txt"):
        pass
    assert names(tmp_path) == []
