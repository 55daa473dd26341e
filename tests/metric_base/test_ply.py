"""Headers of PLY files: what they state is checked before a row is read."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from metric_base.errors import FieldError
from metric_base.ply import ply_layout

POINT = "property float x\nproperty float y\nproperty float z\n"


def header(body: str, form: str = "ascii") -> bytes:
    return f"ply\nformat {form} 1.0\n{body}end_header\n".encode()


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (f"element face 1\n{POINT}", r"elements: expected a vertex element"),
        (f"element vertex 1\n{POINT}property list uchar int i\n", "vertex: expected scalar properties, found .a list"),
        (f"element face 1\nproperty list uchar int i\nelement vertex 1\n{POINT}", "vertex: expected scalar properties"),
        (f"element vertex\n{POINT}", "element: expected a name and a count, found 'element vertex'"),
        (f"element vertex -1\n{POINT}", "element: expected a name and a count"),
        (f"element vertex {10**18}\n{POINT}", "element: expected a name and a count"),
        (f"property float a\nelement vertex 1\n{POINT}", "property: expected a type and a name within an element"),
        (f"element vertex 1\nproperty float\n{POINT}", "property: expected a type and a name within an element"),
        (f"element vertex 1\nproperty half a\n{POINT}", "property 'a': expected a PLY type, found 'half'"),
        (f"element vertex 1\nproperty float x\n{POINT}", "properties: expected each name once"),
        ("element vertex 1\nproperty float x\nproperty float y\n", "vertex: expected properties x, y, z"),
        (f"element vertex 3\n{POINT}", "number of vertices: expected at most 2 "),
    ],
)
def test_an_invalid_header_is_an_error_of_a_field(body: str, message: str) -> None:
    with pytest.raises(FieldError, match=message):
        ply_layout(header(body) + b"1 2 3\n1 2 3")


@pytest.mark.parametrize(
    ("form", "skipped", "rest"), [("ascii", 2, b"1\n2\n0 1 2\n"), ("binary_little_endian", 4, b"abcd" + 12 * b"\0")]
)
def test_elements_before_the_vertices_and_lists_after_them_are_passed_over(
    form: str, skipped: int, rest: bytes
) -> None:
    head = header(
        f"element other 2\nproperty short a\nelement vertex 1\n{POINT}element face 1\nproperty list uchar int i\n", form
    )
    layout = ply_layout(head + rest)
    assert (layout.count, layout.skipped, layout.body, layout.vertex.itemsize) == (1, skipped, len(head), 12)


@pytest.mark.parametrize(("size", "is_read"), [(1 << 16, True), ((1 << 16) + 1, False)])
def test_a_header_has_at_most_64_kilobytes(size: int, is_read: bool) -> None:
    plain = header(f"element vertex 0\n{POINT}")
    room = size - len(plain.rstrip()) - len("comment \n")
    data = plain.replace(b"element", b"comment " + b"a" * room + b"\nelement", 1)
    with nullcontext() if is_read else pytest.raises(FieldError, match="header: expected ply"):
        assert ply_layout(data).body == size + 1
