"""Writing MATLAB v7.3 files as MATLAB lays them out, so that tests need no MATLAB."""

import itertools
from pathlib import Path

import h5py
import numpy as np

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema"
NUMBER = itertools.count()  # what is referred to needs names that no one else has
CLASSES = {"float64": "double", "float32": "single", "complex128": "double", "bool": "logical"}


def write_matlab73(path: Path, variables: dict) -> Path:
    """Arrays, text, dicts (structs) and arrays of objects (cells, arrays of structs)."""
    with h5py.File(path, "w", userblock_size=512) as file:
        references = file.create_group("#refs#")
        for name, value in variables.items():
            put(file, name, value, references)
    with path.open("r+b") as raw:
        raw.write(HEADER.ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def put(group: h5py.Group, name: str, value, references: h5py.Group) -> h5py.HLObject:
    if isinstance(value, dict):
        return put_struct(group, name, value, references)
    if isinstance(value, str):
        codes = np.frombuffer(value.encode("utf-16-le"), dtype="<u2")
        return put_numbers(group, name, codes.reshape(1 if value else 0, len(codes)), "char")
    value = np.asarray(value)
    if value.dtype.kind == "U":
        # As savemat does it: a char matrix, one row per string, padded to equal length.
        width = value.dtype.itemsize // 4
        codes = [[ord(letter) for letter in text.ljust(width)] for text in value.ravel()]
        return put_numbers(group, name, np.array(codes, dtype="<u2"), "char")
    if value.ndim < 2:
        value = value.reshape(1, -1)
    if value.dtype == object and value.size and all(isinstance(v, dict) for v in value.flat):
        return put_structs(group, name, value, references)
    if value.dtype == object:
        entries = [put(references, f"r{next(NUMBER)}", v, references).ref for v in value.flat]
        return put_numbers(group, name, as_references(entries, value.shape), "cell")
    return put_numbers(group, name, value, CLASSES.get(str(value.dtype), str(value.dtype)))


def put_struct(group, name, value, references):
    struct = group.create_group(name)
    for field, entry in value.items():
        put(struct, field, entry, references)
    return mark(struct, "struct", list(value))


def put_structs(group, name, value, references):
    struct = group.create_group(name)
    fields = list(value.flat[0])
    for field in fields:
        entries = [
            put(references, f"r{next(NUMBER)}", v[field], references).ref for v in value.flat
        ]
        struct.create_dataset(field, data=as_references(entries, value.shape).T)
    return mark(struct, "struct", fields)


def put_numbers(group, name, value, kind):
    if not value.size:
        dataset = group.create_dataset(name, data=np.array(value.shape, dtype=np.uint64))
        dataset.attrs["MATLAB_empty"] = np.uint8(1)
    elif value.dtype.kind == "c":
        pairs = np.empty(value.shape, dtype=[("real", float), ("imag", float)])
        pairs["real"], pairs["imag"] = value.real, value.imag
        dataset = group.create_dataset(name, data=pairs.T)
    else:
        stored = value.astype(np.uint8) if value.dtype == bool else value
        dataset = group.create_dataset(name, data=stored.T)
    return mark(dataset, kind)


def put_sparse(group: h5py.Group, name: str, value) -> h5py.HLObject:
    """A SciPy sparse matrix in compressed columns."""
    columns = value.tocsc()
    sparse = group.create_group(name)
    sparse.attrs["MATLAB_sparse"] = np.uint64(columns.shape[0])
    sparse["jc"] = columns.indptr.astype(np.uint64)
    if columns.nnz:
        sparse["data"], sparse["ir"] = columns.data, columns.indices.astype(np.uint64)
    return mark(sparse, "double")


def mark(entry, kind, fields=()):
    entry.attrs["MATLAB_class"] = np.bytes_(kind)
    if fields:
        names = np.empty(len(fields), dtype=object)
        for i, field in enumerate(fields):
            names[i] = np.array([letter.encode() for letter in field], dtype="S1")
        kind = h5py.vlen_dtype(np.dtype("S1"))
        entry.attrs.create("MATLAB_fields", names, dtype=kind)
    return entry


def as_references(entries, shape):
    found = np.empty(len(entries), dtype=h5py.ref_dtype)
    for i, entry in enumerate(entries):
        found[i] = entry
    return found.reshape(shape)
