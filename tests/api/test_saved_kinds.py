"""Kinds of saved results are recognised by the files that their classes name."""

import pkgutil

import pytest

from spacerobot.api.load import STUDIES
from spacerobot.api.saved_kinds import FOLDERS, JSON_FILES, saved_kind
from spacerobot.common.errors import ResultError


def test_every_study_is_recognised_by_its_file_in_the_order_of_the_search():
    classes = {file: pkgutil.resolve_name(kind) for file, kind in FOLDERS.items()}
    assert list(classes.items())[: len(STUDIES)] == [(kind.file, kind) for kind in STUDIES]


def test_every_json_file_is_recognised_by_the_key_of_its_class():
    assert all(pkgutil.resolve_name(kind).key == key for key, kind in JSON_FILES.items())


@pytest.mark.parametrize("file", FOLDERS)
def test_a_folder_is_of_the_kind_of_its_file(tmp_path, file):
    (tmp_path / file).touch()
    assert saved_kind(tmp_path) == FOLDERS[file]


def test_an_evaluation_is_recognised_by_its_first_bytes(tmp_path):
    (tmp_path / "a.nc").write_bytes(b"CDF\x01")
    assert saved_kind(tmp_path / "a.nc") == "optim.evaluation:load_evaluation"
    (tmp_path / "a.nc").write_bytes(b"PDF\x01")
    with pytest.raises(ResultError, match="no result in this file"):
        saved_kind(tmp_path / "a.nc")
