"""What compilers get of kernel files: each line by its own number, and for PoCL in as few words as it needs."""

import re

import pytest

import clfur
from clfur.device import signature, source

STEMS = sorted(path.stem for path in source.kernel_dir().glob("*.cl"))

KERNEL = """/* What it does. */
LARGE ALONE __kernel void add(
    const ulong begin, const ulong end,    // work-items (all), see common.h
    const View view,
    volatile __global uint *sums)          // [n]
{
    WORK_ITEM(i);
    sums[i] += view.size.x;
}
"""
FUNCTION = "static __attribute__((noinline)) void add_of(const size_t i, "
ARGUMENTS = "const ulong begin, const ulong end, const View view, volatile __global uint *sums"
CALLED = f"""/* What it does. */
{FUNCTION}{ARGUMENTS}); ALONE __kernel void add({ARGUMENTS}) {{ WORK_ITEM(i); add_of(i, begin, end, view, sums); }} \
{FUNCTION}
    const ulong begin, const ulong end,    // work-items (all), see common.h
    const View view,
    volatile __global uint *sums)          // [n]
{{

    sums[i] += view.size.x;
}}
"""


def test_a_large_kernel_calls_a_function():
    assert source.once(KERNEL) == CALLED
    some = "{\n#if LANES > 1\n    WORK_ITEM(i);"
    assert source.once(KERNEL.replace("{\n    WORK_ITEM(i);", some)) == CALLED.replace("{\n\n", "{\n#if LANES > 1\n\n")


def test_other_kernels_stay_as_they_are():
    small = KERNEL.replace("LARGE ", "")
    assert source.once(small) == small and source.once(small + KERNEL) == small + CALLED


@pytest.mark.parametrize("stem", STEMS)
def test_each_large_kernel_is_found(stem):
    text = source.read(stem)
    once = source.once(text)
    assert not re.findall(r"\bLARGE .*__kernel", once) and once.count("\n") == text.count("\n")
    assert signature.names(once) == signature.names(text) and signatures(once) == signatures(text)


def signatures(text):
    """Of each kernel its arguments: kind, name, type."""
    return {name: [(type(each), each.name, each.base, each.width) for each in arguments]
            for name, arguments in signature.read(text).items()}


@pytest.mark.parametrize("wrong", ["    sums[i] = NOPE;", "    sums[i] = sqroot(1.0f);"])
def test_lines_keep_their_numbers(gpu, tmp_path, monkeypatch, wrong):
    (tmp_path / "common.h").write_bytes(source.kernel_dir().joinpath("common.h").read_bytes())
    (tmp_path / "oops.cl").write_text(KERNEL.replace("    sums[i] += view.size.x;", wrong), encoding="utf-8")
    monkeypatch.setattr(source, "kernel_dir", lambda: tmp_path)
    with pytest.raises(clfur.DeviceError, match=r"does not build oops\.cl: oops\.cl:8: .*(NOPE|sqroot)"):
        gpu.launch("oops.add", 1)
