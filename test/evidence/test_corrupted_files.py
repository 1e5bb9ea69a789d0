"""Files and folders that cannot be read, wrong meta.json and maps: a message that names them."""

import os
from pathlib import Path

import pytest
from corrupted import (
    TEXT,
    refused,
    write,
)

from sma_sim.evidence.data.recordings import read_dataset, read_recording
from sma_sim.model.errors import UserError


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    refused(tmp_path / 'missing.csv', 'cannot read', 'No such file')
    (tmp_path / 'loop.csv').symlink_to(tmp_path / 'loop.csv')
    refused(tmp_path / 'loop.csv', 'cannot read')
    os.mkfifo(tmp_path / 'pipe.csv')
    refused(tmp_path / 'pipe.csv', 'no regular file')
    path = write(tmp_path, TEXT)

    def denied(self, *arguments, **options):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(Path, 'open', denied)
    refused(path, 'cannot read', 'Permission denied')


def test_a_file_of_very_many_columns_is_told_in_short(tmp_path):
    names = ','.join(f'c{k}' for k in range(5000))
    (tmp_path / 'wide.csv').write_text(f'{names}\n{names}\n')
    with pytest.raises(UserError, match=r'no column time_s, J_eq_W .*; its columns are c0, .*c39 and 4960 more$'):
        read_dataset([tmp_path / 'wide.csv'], 'module', 298.0)


@pytest.mark.parametrize('content', [b'', bytes(range(256)) * 9])
@pytest.mark.parametrize('name', ['run.mcap', 'run.db3'])
def test_bags_in_which_nothing_can_be_read(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=f'{name}: no message in it can be read: the bag is empty or broken'):
        read_dataset([tmp_path / name], 'module', 298.0)


def test_folders_without_recordings(tmp_path):
    with pytest.raises(UserError, match='holds no recording'):
        read_dataset([tmp_path], 'module', 298.0)
    with pytest.raises(UserError, match='at least one recording'):
        read_dataset([], 'module', 298.0)
    write(tmp_path, 'time_s,J_eq_W\n0,1\n1,1\n')
    with pytest.raises(UserError, match='no measurement in it'):
        read_dataset([tmp_path], 'module', 298.0)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('{', 'is not JSON'),
        ('[]', 'expected {"noise_std"'),
        ('{"noise_std": 3}', 'expected {"noise_std"'),
        ('{"noise_std": {"beta": 1}}', 'unknown channel beta'),
        ('{"noise_std": {"alpha": 0}}', 'expected a positive'),
        ('{"noise_std": {"alpha": -1}}', 'expected a positive'),
        ('{"noise_std": {"alpha": "big"}}', "got 'big'"),
        ('{"noise_std": {"alpha": NaN}}', 'expected a positive'),
        ('{"noise_std": {"alpha": true}}', 'expected a positive'),
        ('{"noise_std": {"alpha": Infinity}}', 'expected a positive'),
        ('\x00', 'is not JSON'),
        ('[' * 100000, 'is not JSON'),
    ],
)
def test_wrong_meta(tmp_path, text, words):
    write(tmp_path, TEXT)
    (tmp_path / 'meta.json').write_text(text)
    with pytest.raises(UserError) as caught:
        read_dataset([tmp_path], 'module', 298.0)
    assert words in str(caught.value) and 'meta.json' in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'expected lines such as'),
        ('- a\n', 'expected lines such as'),
        ('a: [', 'is not YAML'),
        ('\x00', 'is not YAML'),
        ('alpha_rad: a\nalpha_rad: b\n', 'alpha_rad is there twice, first in line 1'),
        ('alpha: a\n', 'unknown column alpha; did you mean alpha_rad'),
        ('system: robot\n', "got 'robot'"),
        ('system: wire\n', 'is for --system wire'),
        ('strain: s\n', 'a module has no column strain'),
        ('alpha_rad: 3\n', 'expected {column: NAME'),
        ('alpha_rad: {}\n', 'expected {column: NAME'),
        ('alpha_rad: {column: a, value: 1}\n', 'expected {column: NAME'),
        ('alpha_rad: {column: a, factor: 1}\n', "unknown 'factor'"),
        ('alpha_rad: {column: a, scale: much}\n', 'scale: expected a number'),
        ('alpha_rad: {column: a, scale: 0}\n', 'other than 0'),
        ('alpha_rad: {column: a, scale: .nan}\n', 'scale: expected a number'),
        ('T_E_K: {value: true}\n', 'value: expected a number'),
        ('T_E_K: {value: 1, scale: 2}\n', 'SI units already'),
        ('alpha_rad: angle\n', 'run.csv has no column angle'),
        ('alpha_rad: alpha_radd\n', 'did you mean alpha_rad'),
    ],
)
def test_wrong_maps(tmp_path, text, words):
    path = write(tmp_path, TEXT)
    mapping = tmp_path / 'map.yaml'
    mapping.write_text(text)
    with pytest.raises(UserError) as caught:
        read_recording(path, 'module', 298.0, mapping)
    assert words in str(caught.value) and 'map.yaml' in str(caught.value)
