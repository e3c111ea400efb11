"""Files appear whole or not at all, files that belong together too, and a symbolic link stays one."""

import os
import signal
import subprocess
import sys

import pytest

from lcpimpact.cli.main import main
from lcpimpact.errors import InputError
from lcpimpact.files import atomic_outputs, check_output, check_outputs, whole_file, whole_files

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


@pytest.mark.skipif(os.name == "nt", reason="Windows keeps no modes")
def test_a_file_keeps_its_mode_and_a_new_one_has_that_of_the_user(tmp_path):
    old, new = tmp_path / "old.txt", tmp_path / "new.txt"
    old.write_text("older")
    old.chmod(0o640)
    before = os.umask(0o027)
    try:
        for path in (old, new):
            with whole_file(path) as part:
                part.write_text("newer")
    finally:
        os.umask(before)
    assert (old.stat().st_mode & 0o777, new.stat().st_mode & 0o777) == (0o640, 0o640)
    old.chmod(0o604)
    with whole_file(old) as part:
        part.write_text("newest")
    assert old.stat().st_mode & 0o777 == 0o604


@linked
@pytest.mark.parametrize(
    "way", ["the same name", "another way", "a link", "a hard link", "a link that leads nowhere yet"]
)
def test_an_output_that_is_an_input_or_another_output_is_refused(tmp_path, way):
    first = tmp_path / "a.csv"
    if "yet" not in way:
        first.write_text("older")
    second = {"the same name": first, "another way": tmp_path / "x" / ".." / "a.csv"}.get(way, tmp_path / "b.csv")
    (tmp_path / "x").mkdir()
    if way == "a hard link":
        os.link(first, second)
    elif "link" in way:
        second.symlink_to(first)
    with pytest.raises(InputError, match=r"^cannot write '.*': the input '.*a\.csv' is that file; name another"):
        check_outputs([(second, [".csv"])], [first])
    with pytest.raises(InputError, match=r"^cannot write '.*': another output, '.*a\.csv', is that file; name another"):
        check_outputs([(first, [".csv"]), (None, []), (second, [".csv"])])
    check_outputs([(second, [".csv"])], [tmp_path / "c.csv"])


def test_outputs_of_a_command_appear_all_or_none(tmp_path):
    a, b, other = (tmp_path / f"{name}.txt" for name in ("a", "b", "other"))
    a.write_text("older a")
    named = [(path, [".txt"]) for path in (a, b)]

    def write(then=lambda: None):
        check_outputs(named)
        for path in (a, b, other):
            with whole_file(path) as part:
                part.write_text("newer")
        assert (a.read_text(), b.exists(), other.read_text()) == ("older a", False, "newer")
        then()

    with pytest.raises(ZeroDivisionError), atomic_outputs():
        write(lambda: 1 / 0)
    assert (a.read_text(), names(tmp_path)) == ("older a", ["a.txt", "other.txt"])
    with atomic_outputs():
        write()
    assert (a.read_text(), b.read_text(), names(tmp_path)) == ("newer", "newer", ["a.txt", "b.txt", "other.txt"])


P = "2 1 -5\n1 2 -6\n"
REPLACING = {
    "fit, its measurement": ["fit", "system-1", "--free", "k_o", "--to", "in.csv", "--out", "in.csv"],
    "fit, its scheme": ["fit", "in.toml", "--free", "k", "--to", "in.csv", "--out", "in.toml"],
    "solve, its problem": ["solve", "in.csv", "--out", "in.csv"],
    "solve, its q": ["solve", "M.csv", "--q", "in.csv", "--out", "in.csv"],
    "export": ["export", "in.toml", "--out", "./in.toml"],
    "compare": ["compare", "system-1", "--out", "s.csv", "--events", "s.csv"],
    "converge": ["converge", "system-1", "--out", "s.csv", "--orders", "s.csv"],
    "simulate, its events": ["simulate", "system-1", "--out", "s.csv", "--plot", "s.png"],
}


@linked
@pytest.mark.parametrize("case", REPLACING)
def test_no_command_replaces_its_input_or_its_own_output(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.csv").write_text(P)
    (tmp_path / "in.toml").write_text('problem = "system-1"')
    (tmp_path / "M.csv").write_text("2 1\n1 2\n")
    (tmp_path / "s.events.csv").symlink_to("s.png")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.exists()}
    with pytest.raises(SystemExit) as stop:
        main(REPLACING[case])
    assert stop.value.code == 2
    assert "is that file; name another" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.exists()} == before


def test_a_picture_that_cannot_be_drawn_leaves_the_table_of_the_same_command_unwritten(tmp_path, monkeypatch, capsys):
    def fail(*_):
        raise InputError("no picture")

    monkeypatch.setattr("lcpimpact.plotting.design.plot_design", fail)
    sizes = ["--m", "1", "--v0", "2", "--e", "0.5", "--contact-time", "0.01"]
    with pytest.raises(SystemExit) as stop:
        main(["design", "kelvin-voigt", *sizes, "--out", str(tmp_path / "a.csv"), "--plot", str(tmp_path / "a.png")])
    assert (stop.value.code, names(tmp_path)) == (2, [])


def ended_while_it_writes(folder, program, number):
    """Run ``program`` until it says that it writes to ``folder``, send it the signal, and return how it ended."""
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline().strip() == b"writing"
    assert any(name.startswith(".") for name in names(folder))
    process.send_signal(number)
    process.communicate(timeout=60)
    return process.returncode


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to be caught")
@pytest.mark.parametrize("within", ["whole_file(path)", "atomic_outputs(), whole_file(path)"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_process_that_is_ended_while_it_writes_leaves_no_part(tmp_path, within, number):
    program = f"""if True:
        import signal, sys, time
        from pathlib import Path
        from lcpimpact.files import atomic_outputs, whole_file
        signal.signal(signal.SIGINT, signal.default_int_handler)
        path = Path({str(tmp_path / "a.txt")!r})
        with {within} as part:
            part.write_text("half")
            print("writing", flush=True)
            for _ in range(600):  # a signal that comes just before one long sleep would be heard after it
                time.sleep(0.1)
    """
    assert ended_while_it_writes(tmp_path, program, number) in (1, -number)
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to be caught")
@pytest.mark.parametrize("handled", ["pass", "raise SystemError"])
def test_sigterm_ends_a_process_within_code_that_handles_every_exception(tmp_path, handled):
    program = f"""if True:
        import time
        from pathlib import Path
        from lcpimpact.files import whole_file
        with whole_file(Path({str(tmp_path / "a.txt")!r})) as part:
            part.write_text("half")
            while True:
                try:
                    print("writing", flush=True)
                    time.sleep(0.1)
                except BaseException:
                    {handled}
    """
    assert ended_while_it_writes(tmp_path, program, signal.SIGTERM) == -signal.SIGTERM
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to be caught")
@pytest.mark.parametrize("handled", ["pass", "raise SystemError"])
def test_ctrl_c_ends_a_command_within_code_that_handles_every_exception(tmp_path, handled):
    program = f"""if True:
        import signal, time
        from pathlib import Path
        from lcpimpact.cli import commands
        from lcpimpact.cli.main import main
        from lcpimpact.files import whole_file
        @commands.app.command()
        def loop():
            with whole_file(Path({str(tmp_path / "a.txt")!r})) as part:
                part.write_text("half")
                while True:
                    try:
                        print("writing", flush=True)
                        time.sleep(0.1)
                    except BaseException:
                        {handled}
        signal.signal(signal.SIGINT, signal.default_int_handler)
        main(["loop"])
    """
    assert ended_while_it_writes(tmp_path, program, signal.SIGINT) == 130
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to be caught")
@pytest.mark.parametrize(("number", "left"), [(signal.SIGTERM, "new"), (signal.SIGINT, "old")])
def test_a_signal_between_two_renames_leaves_both_files_new_or_both_old(tmp_path, number, left):
    files = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for file in files:
        file.write_text("old")
    program = f"""if True:
        import signal, time
        from pathlib import Path
        from lcpimpact.files import whole_files
        signal.signal(signal.SIGINT, signal.default_int_handler)
        replace = Path.replace
        def slowly(self, target):
            done = replace(self, target)
            if target.name == "a.txt":
                print("writing", flush=True)
                time.sleep(2)
            return done
        Path.replace = slowly
        with whole_files(*map(Path, {list(map(str, files))!r})) as parts:
            for part in parts:
                part.write_text("new")
    """
    assert ended_while_it_writes(tmp_path, program, number) in (1, -number)
    assert names(tmp_path) == ["a.txt", "b.txt"]
    assert [file.read_text() for file in files] == [left, left]


LONG = "n" * 300

WRITING = [
    ["simulate", "bouncing-ball", "--out", f"{LONG}.csv"],
    ["simulate", "bouncing-ball", "--out", f"{LONG}.nc"],
    ["simulate", "bouncing-ball", "--plot", f"{LONG}.png"],
    ["simulate", "bouncing-ball", "--out", f"{LONG}/x.csv"],
    ["draw", "system-1", "--out", f"{LONG}.svg"],
    ["animate", "system-1", "--out", f"{LONG}.gif"],
    ["export", "system-1", "--out", f"{LONG}.toml"],
    ["explore", "system-1", "--no-open", "--out", f"{LONG}.html"],
    ["converge", "system-1", "--report", f"{LONG}.html"],
    ["compare", "system-1", "--plot", f"{LONG}.pdf"],
    ["cross-validate", "system-1", "--report", f"{LONG}.html"],
    ["work-precision", "system-1", "--out", f"{LONG}.csv"],
    ["sweep", "system-1", "--set", "k_o=3000,4000", "--out", f"{LONG}.zarr"],
    ["sweep", "system-1", "--set", "k_o=3000,4000", "--out", f"{LONG}.csv"],
    ["orbit", "shaw-holmes", "--report", f"{LONG}.html"],
    ["bifurcation", "shaw-holmes", "--over", "omega=2.5:2.6:2", "--out", f"{LONG}.csv"],
    ["solve", "two.lcp", "--out", f"{LONG}.csv"],
    ["reproduce", "--out", LONG],
]


@pytest.mark.parametrize("words", WRITING, ids=lambda words: " ".join(words).replace(LONG, "LONG"))
def test_a_name_that_the_system_does_not_take_is_one_sentence_before_any_run(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    said = capsys.readouterr().err.replace("\n", " ")
    assert "File name too long; name another" in said
    assert names(tmp_path) == []


@pytest.mark.parametrize("letter", ["n", "ä", "漢", "🏀"])
def test_the_longest_name_that_the_system_takes_is_written(letter, tmp_path):
    stem = letter * ((os.pathconf(tmp_path, "PC_NAME_MAX") - 4) // len(letter.encode()))
    with whole_files(tmp_path / f"{stem}.csv", tmp_path / "other.csv") as parts:
        for part in parts:
            part.write_text("new")
    assert names(tmp_path) == sorted([f"{stem}.csv", "other.csv"])
    with pytest.raises(InputError, match="too long"):
        check_output(tmp_path / f"{stem}{letter}{letter}{letter}{letter}.csv", [".csv"])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
@pytest.mark.parametrize("words", [["list", "problems"], ["--help"], ["list", "solvers", "--json"], ["--version"]])
def test_output_that_cannot_be_printed_is_one_sentence(words):
    with open("/dev/full", "w") as full:
        call = [sys.executable, "-m", "lcpimpact", *words]
        ended = subprocess.run(call, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    assert ended.returncode == 2
    assert ended.stderr.splitlines() == [
        "lcpimpact: cannot write what is printed: No space left on device; send it to a place with room"
    ]
