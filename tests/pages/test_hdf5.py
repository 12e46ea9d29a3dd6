"""Files that the HDF5 library cannot be given are found out by another process."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from bayesdeg.pages import hdf5
from bayesdeg.pages.hdf5 import refuse_unsound


@pytest.fixture
def sound(tmp_path):
    path = tmp_path / "sound.h5"
    with h5py.File(path, "w") as file:
        file["group/numbers"] = np.arange(2000.0)
        file["group"].attrs["words"] = np.array(["one", "two"], dtype=h5py.string_dtype())
        file.create_dataset("packed", data=np.arange(500), compression="gzip", chunks=(100,))
    return path


def test_a_sound_file_may_be_read(sound):
    refuse_unsound(sound, "sound", most_mb=1.0)


def test_arrays_that_are_only_promised_are_refused(tmp_path):
    path = tmp_path / "promise.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("large", shape=(10**9,), dtype="f8", chunks=(1000,))
    assert path.stat().st_size < 10_000
    with pytest.raises(ValueError, match="8000 MB"):
        refuse_unsound(path, "promise", most_mb=5.0)


@pytest.mark.parametrize("cut", [0, 7, 100, 4000])
def test_what_is_cut_off_is_refused_with_a_reason(sound, cut):
    sound.write_bytes(sound.read_bytes()[:cut])
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        refuse_unsound(sound, f"cut {cut}", most_mb=1.0)


def test_bits_of_packed_numbers_are_looked_at(sound):
    """Opening a file and looking at its names and sizes would not tell."""
    content = bytearray(sound.read_bytes())
    with h5py.File(sound) as file:
        chunk = file["packed"].id.get_chunk_info(2)
    content[chunk.byte_offset + chunk.size // 2] ^= 0xFF
    sound.write_bytes(content)
    with pytest.raises(ValueError, match=r"inflate|read"):
        refuse_unsound(sound, "packed", most_mb=1.0)


LIMITED = (
    "from bayesdeg.limited import limit_this_process\n"
    f"limit_this_process({hdf5.SECONDS}, {hdf5.MEMORY_MB})\n"
)
PROGRAMS = {
    "goes in circles": "while True: pass",
    "crashes": "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
}


@pytest.mark.parametrize("how", PROGRAMS)
def test_a_process_that_is_lost_takes_nothing_with_it(tmp_path, monkeypatch, how):
    """What stands in for the library here does what it was seen to do with damaged files."""
    program = tmp_path / "program.py"
    program.write_text(LIMITED + PROGRAMS[how], encoding="utf-8")
    monkeypatch.setattr(hdf5, "__file__", str(program))
    with pytest.raises(ValueError, match="timed out"):
        refuse_unsound(tmp_path / "any", how, most_mb=1.0)


def test_memory_is_bounded():
    program = LIMITED + "bytearray(int(5e9))"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.returncode != 0
    assert "MemoryError" in ended.stderr


def test_sound_content_is_looked_at_once_wherever_it_lies(sound, tmp_path, monkeypatch):
    refuse_unsound(sound, "once", most_mb=1.0)
    monkeypatch.delattr(hdf5, "asked")
    refuse_unsound(tmp_path / "copy.h5", "once", most_mb=1.0)
    with pytest.raises(NameError):
        refuse_unsound(tmp_path / "copy.h5", "another", most_mb=1.0)
