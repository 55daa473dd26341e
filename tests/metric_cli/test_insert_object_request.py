"""Arguments of `insert-object` that are checked before a scene is read."""

from __future__ import annotations

import pytest

from insertion.request import ObjectRequest
from metric_base.errors import InputError
from metric_cli.insert_object.insert import parse_objects, parse_request
from metric_cli.insert_object.parser import parser


def objects(*arguments: str) -> list[ObjectRequest]:
    options = parser().parse_args(["scene", "--model", "a.glb", *arguments, "--out", "absent.mp4"])
    return parse_objects(options.objects)


def test_options_belong_to_the_model_before_them() -> None:
    first, second = objects("--size", "height=2", "--model", "b.glb", "--on", "couch")
    assert (first.size, first.on) == ("height=2", None)
    assert (second.size, second.on) == ("file", "couch")


def test_an_option_of_an_object_needs_a_model() -> None:
    with pytest.raises(InputError, match="--size: expected --model before it"):
        parser().parse_args(["scene", "--size", "prior", "--model", "a.glb"])


@pytest.mark.parametrize(
    ("option", "valid", "invalid"),
    [
        ("--at-time", "0", "-0.01"),
        ("--at-time", "1000000", "1000001"),
        ("--path-start", "0", "-0.01"),
        ("--path-start", "1000000", "1000001"),
        ("--speed", "0.001", "0.0009"),
        ("--speed", "1000", "1001"),
        ("--xy", "-999999,0", "0,1000000"),
    ],
)
def test_numbers_outside_of_their_range_are_refused(option: str, valid: str, invalid: str) -> None:
    assert len(objects(option, valid)) == 1
    with pytest.raises(InputError, match=option):
        objects(option, invalid)


def test_one_way_to_give_a_position() -> None:
    with pytest.raises(InputError, match="--at: expected one of --at, --on and --plane; found also --plane"):
        objects("--at", "auto", "--plane", "1")


@pytest.mark.parametrize(("port", "option"), [("65536", "--place"), ("-1", "--place"), ("65535", "scale")])
def test_ports_of_the_placement_page(port: str, option: str) -> None:
    with pytest.raises(InputError, match=option):  # a valid port leads to the next error: the scene has no scale
        parse_request(["absent", "--model", "a.glb", f"--place={port}"])
