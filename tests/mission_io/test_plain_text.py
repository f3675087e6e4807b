"""Text that arrives over a link is harmless wherever it is shown, whatever message carries it."""

import json
import random
import unicodedata

import pytest

from mission_io.model.plain_text import counted, escaped_json, plain_lines, plain_text, plain_values
from mission_io.wire.codec import Codec, mavlink2_frame
from mission_io.wire.message_table import ROWS
from tests.hostile_text import HOSTILE, control_characters, hostile_bytes


def text_slots():
    """Every field of every message that holds text, by its place among the packed values."""
    for row in ROWS:
        for field, slot in zip(row.fields, row.slots, strict=True):
            sample = row.layout.struct.unpack(bytes(row.layout.struct.size))
            if isinstance(slot, int) and isinstance(sample[slot], bytes):
                yield pytest.param(row, field.name, slot, id=f"{row.layout.name}.{field.name}")


SLOTS = list(text_slots())


def test_the_messages_that_carry_text_are_found():
    names = {slot.id for slot in SLOTS}
    assert {"statustext.text", "param_value.name", "param_ext_value.name", "param_error.name"} <= names


@pytest.mark.parametrize(("row", "name", "slot"), SLOTS)
def test_no_message_carries_control_characters_in(row, name, slot):
    rng = random.Random(11)
    values = list(row.layout.struct.unpack(bytes(row.layout.struct.size)))
    codec = Codec(system_id=255, component_id=190)
    for seq in range(200):
        values[slot] = hostile_bytes(rng, 50)
        payload = row.layout.struct.pack(*values)
        frame = mavlink2_frame(row.layout.message_id, payload, seq=seq, system_id=1, component_id=1)
        (received,) = codec.decode(frame)
        text = getattr(received.message, name)
        assert isinstance(text, str | bytes)
        if isinstance(text, str):
            assert control_characters(text) == set(), text


def test_pieces_of_a_text_keep_their_length():
    assert len(plain_text("\x1b[2J" + "a" * 46)) == 50  # a shorter one would be taken for the last


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_becomes_plain(text):
    shown = plain_text(text)
    assert control_characters(shown) == set()
    assert "\n" not in shown
    assert plain_text(shown) == shown
    assert control_characters(plain_lines(text)) <= {"\n", "\t"}
    assert plain_values({text: [text, 1, {"a": (text,)}]}) == {shown: [shown, 1, {"a": [shown]}]}


@pytest.mark.parametrize("text", HOSTILE)
def test_json_keeps_hostile_text_in_escapes(text):
    document = {"name": text, "ü": [text]}
    shown = escaped_json(json.dumps(document, ensure_ascii=False, indent=1))
    assert control_characters(shown) <= {"\n"}
    assert json.loads(shown) == document


@pytest.mark.parametrize("text", ["Überflug 50 m²", "日本語 测试", "नमस्ते", "Ω ≤ 20°", "🛩 42", ""])
def test_text_of_any_language_stays(text):
    assert plain_text(text) == text


def test_every_control_and_format_character_goes():
    every = [chr(number) for number in range(0x110000)]
    left = {unicodedata.category(char) for char in every if plain_text(char) == char}
    assert not left & {"Cc", "Cs", "Zl", "Zp"}
    kept = [char for char in every if unicodedata.category(char) == "Cf" and plain_text(char) == char]
    assert {unicodedata.name(char).split()[0] for char in kept} <= {
        "ARABIC",
        "SYRIAC",
        "KAITHI",
        "EGYPTIAN",
        "SHORTHAND",
    }


def test_one_thing_is_singular() -> None:
    assert [counted(n, "photo") for n in (0, 1, 2)] == ["0 photos", "1 photo", "2 photos"]
    assert [counted(n, "entry", "entries") for n in (0, 1)] == ["0 entries", "1 entry"]
