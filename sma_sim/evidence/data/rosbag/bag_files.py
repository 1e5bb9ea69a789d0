"""What is a bag, and which files it has; nothing is read, so that no library of bags is imported to tell."""

from __future__ import annotations

from pathlib import Path

METADATA = 'metadata.yaml'
STORAGES = ('.mcap', '.db3')


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a storage file, or a folder with metadata or with storage files named after it."""
    if path.is_dir():
        return (path / METADATA).is_file() or any(belongs_to_bag(path, file) for file in storage_files(path))
    return path.suffix in STORAGES


def belongs_to_bag(folder: Path, file: Path) -> bool:
    """Whether a file is named as a recorder names the files of a bag: `name_0.mcap`, or `name.mcap`."""
    name, _, number = file.stem.rpartition('_')
    return file.stem == folder.name or name == folder.name and number.isdigit()


def storage_files(path: Path) -> list[Path]:
    """The files that hold a bag's messages, in the order of their numbers."""
    if path.is_file():
        return [path]
    found = [file for file in path.iterdir() if file.suffix in STORAGES]
    return sorted(found, key=lambda file: (len(file.name), file.name))
