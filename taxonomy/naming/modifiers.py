"""Words around a name that leave the thing the same: colours, materials, states, rooms, counts, and what follows it."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = [
    "ALIENATING",
    "CONTAINERS",
    "OF_THE_LIVING",
    "after_counts",
    "container_and_content",
    "is_plain_adjective",
    "leading_phrase",
    "modifiers",
    "without_numbers",
]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_COLOURS = _words(
    "amber aqua azure beige black blue bronze brown burgundy charcoal colored colorful colourful copper cream "
    "crimson cyan dark golden gold gray green indigo ivory lavender light lilac magenta maroon mauve multicolored "
    "navy neon ochre olive orange pale pastel pink plum purple red rose rust salmon sapphire scarlet silver tan "
    "teal turquoise two-tone vermilion violet white yellow bright"
)
_MATERIALS = _words(
    "acrylic aluminum bamboo brass brick canvas cardboard carbon cast ceramic chrome clay cloth concrete copper "
    "cotton crystal denim enamel fabric faux felt fiberglass foam glass granite iron jute lace latex laminated "
    "leather linen marble mesh metal metallic mosaic nylon oak paper pine plastic plastered plush plywood polished "
    "porcelain rattan resin rubber satin silicone silk slate stainless steel stone straw suede teak terracotta tin "
    "titanium tweed upholstered velvet vinyl walnut wicker wire wood wooden wool woollen woven earthenware "
    "stoneware mahogany melamine"
)
_SIZES = _words(
    "big biggest broad bulky deep enormous extra fat full-size fullsize giant gigantic heavy huge jumbo large "
    "larger largest little long low massive medium mini miniature narrow oversized petite regular short shallow "
    "slim small smaller sized smallest standard tall tallish thick thin tiny wide adult baby full length half "
    "size xl xxl compact"
)
_SHAPES = _words(
    "angular arched circular conical cubic curved cylindrical domed flat hexagonal l-shaped oblong octagonal open "
    "oval pointed rectangular round rounded sharp square squared straight triangular u-shaped corner twin double "
    "single"
)
_STATES = _words(
    "abandoned aged ancient antique assembled attached bare beautiful bent blank blurred blurry boiled broken "
    "burning capped carved cheap chipped classic clean closed cluttered cold comfortable contemporary cooked "
    "covered cracked cropped crumpled cute damaged dead decorated decorative decorated detached dirty disassembled "
    "displayed distant dry dusty elegant embroidered empty engraved expensive faded fancy far filled fitted folded "
    "fresh framed freestanding frozen full functional generic glossy hand handmade hanging hot illuminated inflated "
    "installed leaning lit loaded lone locked lovely luxury lying matte messy metal-framed modern moving mounted "
    "natural neat new nice normal occluded occupied old older one-piece ordinary ornate overturned packed padded "
    "painted parked partial partially patterned peeled perforated plain portable pretty printed quilted raised raw "
    "real reclined retro ripe rolled rotten running rustic rusty scratched sealed shiny shut sitting sleek sliced "
    "soft hard solid stacked stained standing stationary striped stripped sturdy stylish toppled torn traditional "
    "translucent transparent typical unknown unlit unopened upright upside used vacant vintage visible mounted "
    "walking wet whole wild worn wrapped young younger elderly unpainted adjustable collapsible removable "
    "detachable digital electric electrical electronic automatic cordless wireless manual disposable reusable "
    "flying driving riding"
)
_PATTERNS = _words("checked checkered dotted floral plaid polka spotted tartan zebra-striped ribbed textured")
_PLACES = _words(
    "attic balcony backyard bathroom bedroom camping children childrens classroom dining domestic entryway exterior "
    "factory front back garage garden guest hall hallway home hotel house household indoor industrial interior kids "
    "kitchen laboratory lab laundry living left right lounge lobby mens middle nearby nursery office outdoor patio "
    "playroom public restaurant room roadside rear school shop side store street student terrace top bottom upper "
    "lower urban womens workshop main first second third local city town village rural another other same own my "
    "your his her their our this that these those some any"
)

_MODIFIERS = _COLOURS | _MATERIALS | _SIZES | _SHAPES | _STATES | _PATTERNS | _PLACES

#: Second words of what people write with a hyphen: wall-mounted, oval-shaped.
_COMPOUNDING = _words("backed based colored coloured framed length mounted patterned shaped size sized style topped")

#: Words that make another thing of the thing: a toy truck is no truck. Nothing is stripped beyond them.
ALIENATING = _words(
    "toy model fake dummy doll dollhouse lego replica miniature play pretend inflatable chocolate sand snow ice "
    "rocking paper water fire hot electric electrical baby french air star wall"
)

#: Words that leave an animal or a person the same, and no thing: a baby elephant is an elephant, a baby walker nobody.
OF_THE_LIVING = _words("adult baby wild young elderly")

#: Things that are what they are, whatever is in them.
CONTAINERS = _words("bag basket bottle bowl box bucket can carton case crate cup glass jar jug mug packet pot tin tray")

_NUMBER = re.compile(r"(?<![\w/])[#(]?\d+(?:[.,x×]\d+)*(?:-|\s)?(?:inch|inches|in|cm|mm|m|ft|l|ml|oz)?\)?(?![\w/])")
# nothing is given back once it is taken: digits can be parted in more ways than there is time to try
_SUFFIX = re.compile(r"(?:\s*+[#(]\d++\)?+|[._ #-]*+\d++)++$")
_ARTICLES = re.compile(r"^(?:an?|the|one|two|three|four|five|six|several|many|some|few|multiple)\s+", re.IGNORECASE)

#: What counts or holds the thing that is named after `of`.
_COUNTS = re.compile(
    r"^(?:a\s+|the\s+)?(?:close[- ]?up|photo|picture|image|view|pair|pairs|set|group|stack|pile|bunch|row|rows|herd|"
    r"flock|pack|piece|pieces|collection|lot|roll|couple|heap|crowd|type|kind|part|cluster|number|slice)s?\s+of\s+"
    r"(?:an?\s+|the\s+|\d+\s+)?(?P<rest>.+)$",
    re.IGNORECASE,
)

#: Begins what is said about a thing after its name.
_AFTER = re.compile(
    r"\s+(?:with|without|in|on|at|near|next|beside|behind|under|by|from|against|above|below|inside|who|that|which|for|"
    r"wearing|riding|holding|carrying|sitting|standing|lying|walking|running|driving|parked|made|using|playing|eating|"
    r"looking|leaning|hanging|mounted|covered|filled|full|and)\b.*$",
    re.IGNORECASE,
)


def without_numbers(text: str) -> str:
    """The text without counts, sizes, running numbers and articles: `2 chairs`, `chair.001`, `55 inch tv`, `the chair`.

    >>> without_numbers("chair.001"), without_numbers("the 55-inch tv")
    ('chair', 'tv')
    """
    plain = _SUFFIX.sub("", text.strip()) or text
    plain = _ARTICLES.sub("", plain.strip())
    bare = " ".join(_NUMBER.sub(" ", plain).split())
    return _ARTICLES.sub("", bare).strip() or plain


def after_counts(text: str) -> str | None:
    """What a count names: `scissors` of `pair of scissors`; None where nothing is counted."""
    counted = _COUNTS.match(text)
    return counted["rest"] if counted else None


def container_and_content(text: str) -> tuple[str, str] | None:
    """The container and its content in `a cup of coffee`; None where no container is named before `of`.

    >>> container_and_content("a glass of red wine")
    ('glass', 'red wine')
    """
    first, of, rest = _ARTICLES.sub("", text.strip()).partition(" of ")
    container = first.strip().lower()
    return (container, rest.strip()) if of and container in CONTAINERS and rest.strip() else None


def leading_phrase(text: str) -> str | None:
    """The name before what is said about it: `man` of `man riding a bike`; None where nothing follows.

    >>> leading_phrase("woman with umbrella")
    'woman'
    """
    cut = _AFTER.sub("", text).strip()
    return cut if cut and cut != text.strip() else None


def modifiers(words: Sequence[str]) -> int:
    """How many of the first words leave the thing the same: one colour, or the two of `wall-mounted`."""
    if len(words) > 2 and words[1] in _COMPOUNDING:
        return 2
    return int(bool(words) and words[0] in _MODIFIERS)


def is_plain_adjective(word: str) -> bool:
    """Whether the word is a colour or a size, so that a compound that begins with it is rarely a name."""
    return word in _COLOURS or word in _SIZES or word in {"old", "young", "new"}
