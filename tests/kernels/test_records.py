"""Records shared with the device: the kernels' layout is the host's, field by field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.kernels import run

from mbinterval.device.kernel_effects import effect_options
from mbinterval.device.records import _VARIANTS, BY_NAME


def probe_source(name: str, dtype: np.dtype) -> str:
    """A kernel that reports a record's size, each field's offset and size, and reads its values.

    The fields are those of ``dtype``; a field that the device doesn't know fails to compile.
    """
    lines = [
        '#include "shared/records.h"',
        f"kernel void probe(global const {name} *in, global ulong *layout, global double *values)",
        "{",
        f"    {name} r = in[0];",
        "    uint place = 0, value = 0;",
        f"    layout[place++] = sizeof({name});",
    ]
    for field in dtype.names:
        lines.append(f"    layout[place++] = (ulong)&in->{field} - (ulong)in;")
        lines.append(f"    layout[place++] = sizeof(r.{field});")
        count = int(np.prod(dtype[field].shape, dtype=int))
        for i in range(count):
            element = f"r.{field}[{i}]" if dtype[field].shape else f"r.{field}"
            lines.append(f"    values[value++] = (double)({element});")
    return "\n".join([*lines, "}", ""])


def device_layout(
    folder: Path, name: str, dtype: np.dtype, *effects: str
) -> tuple[list[int], np.ndarray]:
    """Layout of record ``name`` on the device, and the values that it reads of a sample."""
    file = folder / f"probe_{name}.cl"
    file.write_text(probe_source(name, dtype))
    elements = sum(int(np.prod(dtype[field].shape, dtype=int)) for field in dtype.names)
    arguments = [sample(dtype), np.zeros(1 + 2 * len(dtype.names), np.uint64), np.zeros(elements)]
    _, layout, values = run(file, "probe", arguments, effect_options(effects))
    return layout.tolist(), values


def host_layout(dtype: np.dtype) -> list[int]:
    layout = [dtype.itemsize]
    for field in dtype.names:
        layout += [dtype.fields[field][1], dtype[field].itemsize]
    return layout


def sample(dtype: np.dtype) -> np.ndarray:
    """One record of different values that tell floats from integers, and signed from unsigned."""
    record, place = np.zeros(1, dtype), 0
    for field in dtype.names:
        kind, values = dtype[field].base.kind, record[field].reshape(-1)
        start = {"f": 0.5, "i": -1, "u": 2**31}[kind]
        values[:] = start + np.arange(place, place + len(values)) * (-1 if kind == "i" else 1)
        record[field] = values.reshape(record[field].shape)
        place += len(values)
    return record


def flattened(record: np.ndarray) -> np.ndarray:
    fields = [np.ravel(record[name]).astype(np.float64) for name in record.dtype.names]
    return np.concatenate(fields)


@pytest.mark.parametrize("name", BY_NAME)
def test_the_device_lays_a_record_out_as_the_host_does(name, tmp_path):
    dtype = BY_NAME[name]
    layout, values = device_layout(tmp_path, name, dtype)
    assert layout == host_layout(dtype)
    assert np.array_equal(values, flattened(sample(dtype)))


def test_every_record_of_the_header_has_a_dtype():
    from mbinterval.device.sources import kernel_root

    header = (kernel_root() / "shared" / "records.h").read_text(encoding="utf-8")
    declared = {line[2:-1] for line in header.splitlines() if line.startswith("} ")}
    assert declared == set(BY_NAME)


@pytest.mark.parametrize(("name", "effect"), _VARIANTS)
def test_records_that_grow_with_an_effect_are_laid_out_alike_too(name, effect, tmp_path):
    dtype = _VARIANTS[name, effect]
    layout, values = device_layout(tmp_path, name, dtype, effect)
    assert layout == host_layout(dtype) != host_layout(BY_NAME[name])
    assert np.array_equal(values, flattened(sample(dtype)))


CHANGES = {
    "swapped": lambda fields: [fields[1], fields[0], *fields[2:]],
    "wider": lambda fields: [(fields[0][0], "f8"), *fields[1:]],
    "lost": lambda fields: fields[:-1],
    "retyped": lambda fields: [*fields[:-1], (fields[-1][0], "f4")],
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_dtype_is_told_apart(change, tmp_path):
    dtype = BY_NAME["Fragment"]
    fields = [(name, dtype[name].str) for name in dtype.names]
    changed = np.dtype(CHANGES[change](fields))
    layout, values = device_layout(tmp_path, "Fragment", changed)
    same = layout == host_layout(changed) and np.array_equal(values, flattened(sample(changed)))
    assert not same
