"""Words of the code: no dialect; docstrings begin with a short sentence that is no question."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

REPO = Path(__file__).parents[1]
PACKAGES = (
    "uavcover/__init__.py", "uavcover/cli", "uavcover/extras", "uavcover/flight", "uavcover/kernels",
    "uavcover/missions", "uavcover/mock", "uavcover/model", "uavcover/new", "uavcover/optimizers", "uavcover/planner",
    "uavcover/plugins.py", "uavcover/recording", "uavcover/report", "uavcover/run", "uavcover/scenario",
    "uavcover/sensing", "uavcover/terrain", "uavcover/verification", "mission_io",
)  # fmt: skip
"""Packages, and modules, whose words are held."""

DIALECT = (
    "so many", "so long", "nobody", "likewise", "dear", "dearer", "hardly", "lately", "what is asked", "is asked for",
    "was asked for", "tell of", "tells of", "told", "goes with", "made small", "give way", "gives way", "whoever",
    "whatever", "ways there and home", "who asks", "shall",
)  # fmt: skip
PUBLIC_NAMES = ("told(",)
"""`FakeVehicle.told`, a name that users of `mission_io.conformance` call."""
CLEARED = frozenset(
    ("asked", "beginning", "beginnings", "dear", "dearer", "dearest", "fluke", "flukes", "luck", "mended", "nose", "noses",
     "patience", "picture", "pictures", "place", "places", "possibly", "seen", "sees", "share", "shares", "surely", "told",
     "unseen", "way", "ways")
)  # fmt: skip
"""Words that identifiers do not have, as whole parts of their names."""
PUBLIC_IDENTIFIERS = frozenset(
    ("IN_PLACE", "SHARE", "StartPictures", "StopPictures", "TakePicture", "_asked", "asked", "at_share", "can_share_files",
     "column_shares", "fewest_places", "idle_share", "picture_every", "pictures", "pictures_taken", "possibly_covered_fraction",
     "possibly_in_view", "possibly_m", "profile_share", "row_shares", "seen", "seen_twice_fraction",
     "surely_covered_fraction", "surely_covered_of_coverable", "surely_in_view", "told")
)  # fmt: skip
"""Keys of files, options, interfaces of others, and names that users import or override."""
MOST_WORDS, MOST_LONG = 20, 0.05
"""Words of the first sentence of a docstring, and the share of docstrings that may have more."""

_DIALECT = re.compile(rf"\b({'|'.join(DIALECT)})\b".replace(" ", r"\s"), re.IGNORECASE)
_LINE_BREAK = re.compile(r"\n[ \t]*(#:? ?)?")
_QUESTION = re.compile(r"(What|Who|Whom|Whose|How|Why|So many)\b")


def dialect_in(source: str) -> list[str]:
    """Dialect words of a source text, also across the lines of a sentence."""
    text = re.sub(r"\s+", " ", _LINE_BREAK.sub(" ", source))
    return [m[1] for m in _DIALECT.finditer(text) if not text.startswith(PUBLIC_NAMES, m.start())]


def dialect_names(source: str) -> set[str]:
    """Identifiers of a source text that have a cleared word."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    names = {token.string for token in tokens if token.type == tokenize.NAME} - PUBLIC_IDENTIFIERS
    return {name for name in names if CLEARED & {part.lower() for part in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)}}


def first_sentences(source: str) -> Iterator[str]:
    """The first sentence of each docstring of a source text."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield re.split(r"(?<=[.!?])\s", " ".join(text.split("\n\n")[0].split()))[0]


def sources(package: str) -> dict[str, str]:
    path = REPO / package
    files = [path] if path.is_file() else sorted(path.rglob("*.py"))
    assert files, f"{package} is not there: rename it in PACKAGES"
    return {str(file.relative_to(REPO)): file.read_text("utf-8") for file in files}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_dialect(package):
    found = {name: words for name, source in sources(package).items() if (words := dialect_in(source))}
    assert not found


@pytest.mark.parametrize("package", PACKAGES)
def test_no_dialect_in_names(package):
    found = {name: words for name, source in sources(package).items() if (words := dialect_names(source))}
    assert not found


@pytest.mark.parametrize("package", PACKAGES)
def test_first_sentences_are_short(package):
    sentences = [sentence for source in sources(package).values() for sentence in first_sentences(source)]
    long = [sentence for sentence in sentences if len(sentence.split()) > MOST_WORDS]
    assert len(long) <= MOST_LONG * len(sentences), long


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_do_not_begin_with_a_question(package):
    found = [s for source in sources(package).values() for s in first_sentences(source) if _QUESTION.match(s)]
    assert not found


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ('"""After so\n    many tries."""', ["so many"]),
        ("# the list is asked\n# for again", ["is asked for"]),
        ("NOBODY = 77", ["NOBODY"]),
        ("vehicle.told(True)", []),
        ("told = 3", ["told"]),
        ("nobody_else", []),
    ],
)
def test_the_search_for_dialect(source, words):
    assert dialect_in(source) == words


def test_the_search_for_names():
    assert dialect_names("IN_PLACE = way_m(LinkShare, placed, 'place')") == {"way_m", "LinkShare"}


def test_the_search_for_first_sentences():
    source = '"""One. Two."""\nclass A:\n    """What it is."""\n    async def b(self):\n        """Do it.\n\n        More."""\n'
    assert sorted(first_sentences(source)) == ["Do it.", "One.", "What it is."]
