from bayesdeg.actuator.mkl import VARIABLE, name_library


def test_the_library_of_the_environment_is_named(tmp_path):
    library = tmp_path / "lib" / "libmkl_rt.so.3"
    library.parent.mkdir()
    library.touch()
    environment = {}
    name_library(tmp_path, environment)
    assert environment == {VARIABLE: str(library)}


def test_what_the_user_named_stays(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libmkl_rt.so.3").touch()
    environment = {VARIABLE: "mine.so"}
    name_library(tmp_path, environment)
    assert environment == {VARIABLE: "mine.so"}


def test_where_there_is_none_nothing_is_named(tmp_path):
    environment = {}
    name_library(tmp_path, environment)
    assert environment == {}
