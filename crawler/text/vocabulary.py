"""Vocabulary of product pages: words for axes, sizes, the whole product, its parts and its package.

The languages are English, German, French, Italian, Spanish, Portuguese and Dutch. Words are in lower case and without
accents (`plain`), because some pages omit accents.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

Axis = Literal["length", "width", "height", "depth", "diameter"]
Language = Literal["en", "de", "fr", "it", "es", "pt", "nl"]

#: Invisible characters: direction marks, zero-width spaces, soft hyphens, byte-order marks.
_INVISIBLE = re.compile("[\u00ad\u034f\u061c\u200b-\u200f\u202a-\u202e\u2060-\u2064\u2066-\u2069\ufeff\ufe0e\ufe0f]")

#: Cache of the tests below: the labels of a site are the same on every page, and each is tested several times.
_cached = lru_cache(maxsize=4096)


@_cached
def plain(text: str) -> str:
    """Return a text in lower case, with single spaces and without accents and invisible characters."""
    if text.isascii():
        return " ".join(text.lower().split())
    letters = unicodedata.normalize("NFKD", _INVISIBLE.sub("", text).casefold())
    return " ".join("".join(c for c in letters if not unicodedata.combining(c)).split())


#: Axes by word; `largo` is a length, `fondo` and `profondeur` are depths.
AXIS_WORDS: Mapping[str, str] = MappingProxyType(
    {
        word: axis
        for axis, words in {
            "length": "length long longueur lunghezza lungh largo longitud comprimento compr lange laenge lengte lang",
            "width": "width wide breadth beam breite breit largeur large larg larghezza ancho anchura largura breedte "
            "breed wingspan envergure spannweite spanwijdte envergadura",
            "height": "height high tall hohe hoehe hoch hauteur haut altezza alto altura alt hoogte hoog",
            "depth": "depth deep thickness thick tiefe tief dicke dick starke profondeur profond prof epaisseur "
            "profondita profondo spessore profundidad profundo fondo grosor espesor profundidade espessura diepte diep "
            "dikte dik",
            "diameter": "diameter diam dia durchmesser diametre diametro ø ⌀ doorsnede",
        }.items()
        for word in words.split()
    }
)

_PACKAGE = re.compile(
    r"\b("
    r"pack(ag(e|ed|ing)|ed|ing)?|parcel|shipping|shipped|ship (dim\w*|size|width|height|length|depth|weight)"
    r"|carton|boxed|box (dim\w*|sizes?|width|height|length|depth|weight)|delivery|gift box|master case|inner box"
    r"|outer box|pallets?|verpack\w*|paket\w*|versand\w*|karton\w*|lieferung|emball\w*|colis|carton d"
    r"|embalad[oa]s?|empaques?|empacad[oa]s?"
    r"|livraison|imball\w*|confezione|spedizione|pacco|embalaje|envio|paquete|caja|embalagem|caixa"
    r"|verpakking\w*|verzend\w*|pakket\w*|doos|in (the )?box|folded for (shipping|transport)"
    # bags and cases
    r"|carry(ing)? (bag|case)|stuff sack|packmass\w*|packsack|trage(tasche|beutel)|housse|sac de transport"
    r"|custodia|sacca|bolsa de transporte|saco de transporte|draagtas"
    r")\b"
)

#: `Size without packaging` is the size of the item.
_UNPACKED = re.compile(
    r"\b(without|excl\w*|ohne|hors|sans|senza|sin|sem|zonder)( the| the product)? "
    r"(pack(age|aging)?|verpackung|emballage|imball\w*|confezione|embalaje|embalagem|verpakking|box)\b"
)

#: Headings of other products.
_OTHERS = re.compile(
    r"\b("
    r"you (may|might|could) also|also (like|bought|viewed|view|buy)|(frequently|often) bought|recommended for"
    r"|(similar|related|recommended|more) (items|products|articles|pieces|from)|recently viewed"
    r"|compare (with|to) similar|complete the (look|set)|(works|compatible) with|kompatibel mit|compatible avec"
    r"|auch gefallen|auch interessieren|kauften auch|ahnliche|passend dazu|dazu passt|wird oft zusammen"
    r"|zuletzt angesehen"
    r"|aimerez aussi|produits? (complementaires|similaires|associes)|articles (similaires|complementaires)"
    r"|(potrebbe|potrebbero) (anche )?(interessar|piacer)\w*|prodotti (simili|correlati)|acquistati insieme"
    r"|(puede|pueden|podria|podrian) (interesar|gustar)\w*|productos (relacionados|similares)|comprados juntos"
    r"|tambem (pode|podem|viu|viram|compraram)|produtos (relacionados|similares|semelhantes)"
    r"|anderen (bekeken|kochten) ook|vergelijkbare|bekijk ook|vaak samen"
    r")\b"
)

#: Parts that a size includes or excludes: `depth (excluding handles)`.
_ASIDE = re.compile(
    r"\b(excluding|excl|without|including|incl|inkl|inklusive|exkl|ohne|sans|hors|senza|sin|sem|zonder|exclusief"
    r"|inclusief)\b\.? \w+"
    r"|\b(with|mit|avec|con|com|met) (the )?(stand|base|feet|foot|standfuss|fuss|pied|piede|supporto|peana|voet)\b"
)

_WEIGHT = r"(?:weights?|gewicht|poids|peso|capacity)"
_AND = r"(?:[&/,+]|\b(?:and|und|et|e|y|en)\b)"
#: Headings of sizes and weights: `dimensions & weight`, `Gewicht und Abmessungen`.
_AND_WEIGHT = re.compile(rf"{_AND}\s*{_WEIGHT}\b|\b{_WEIGHT}\s*{_AND}")

#: An order of axes, and a word before it in the data of lenses: `max. diameter x length`.
_ORDER = re.compile(r"[^\W\d_]{2,} ?[x×] ?[^\W\d_]{2,}")
_MOST = re.compile(r"\bmax(?:imum)?\b\.?(?= [^\W\d_]{2,} ?[x×])")

#: Parts that a size includes: `(kettle + base)`.
_TOGETHER = re.compile(r"\([^()]*(?:[&+]|\b(?:and|und|et|e|y|en)\b)[^()]*\)")

#: The whole item, although its name is that of a part: `the complete model`.
_COMPLETE = re.compile(r"\b(?:complete|completed|finished|assembled|entire|whole) \w+")

_WHOLE = re.compile(
    r"\b("
    r"overall|total|assembled|product|item|article|unit|external|exterior|outer|outside|gesamt\w*"
    r"|produkt\w*|artikel\w*|aufgebaut|aussen\w*|montiert|produit|hors tout|totale?s?|globale?s?"
    r"|exterieur\w*|prodotto|articolo|totali|complessiv\w*|estern\w*|producto|articulo|exterior\w*"
    r"|produto|artigo|totaal|buiten\w*|architectural"
    r")\b"
)

#: Parts of items, states of items (folded, extended) and other quantities: their sizes are not the size of the item.
_COMPONENT = re.compile(
    r"\b("
    r"seat\w*|sh|arm\w*|foot ?(rest|board)s?|head ?(rest|board)s?|back ?(rest|plate|height|width|panel)?|backplate"
    r"|base|leg|legs|foot|footprint"
    r"|feet|shade|lampshade|cord|cable|canopy|drawer\w*|shelf|shelves|door|tabletop|table top"
    r"|top (width|depth|thickness)|interior|inner|inside|internal|opening|cut ?-?out|clearance|screen"
    r"|display|sensor|viewing|panel|frame (size|thickness|width)|mattress|cushion\w*|pillow|handle\w*"
    r"|hook|chain|plug|tank|basket|bowl size|lens|strap\w*|wheel\w*|tyre|tire|caster\w*|mount\w*|image"
    r"|photo|picture|print (size|area)|page|paper size|focal|range|min(imum)?|max(imum)?|adjust\w*"
    r"|extended|extends|folded|recline\w*|distance|weight\w*|capacity|volume|load|box|user|model"
    r"|person|sitz\w*|arm(lehne|lehnen|hohe)\w*|rucken\w*|lehne\w*|kabel\w*|bein\w*|fuss\w*|schirm\w*"
    r"|schublade\w*|fach\w*|innen\w*|bildschirm\w*|assise|accoudoir\w*|dossier|pieds?|tiroir\w*"
    r"|interieur\w*|ecran|abat|plateau|seduta|bracciol\w*|schienale|gamb[ae]|piede|cassett\w*"
    r"|intern\w*|schermo|cavo|asiento|reposabrazos|respaldo|patas?|cajon\w*|interior\w*|pantalla"
    r"|plie(e|s|es)?|zusammengeklappt|gefaltet|geklappt|piegat[oaie]|chius[oaie]|plegad[oa]s?|dobrad[oa]s?|fechad[oa]s?"
    r"|ingeklapt|opgevouwen|collapsed|closed"
    # openings for built-in items
    r"|nischen?\w*|einbau\w*|niche|nicho|nicchia|encastrement|incasso|inbouw\w*|built ?-?in (size|dim\w*)"
    r"|assento|encosto|bracos?|pes|gaveta\w*|ecra|tela|cabo|zit\w*|armleuning\w*|rugleuning\w*|poot"
    r"|poten|lade\w*|binnen\w*|scherm\w*|snoer\w*"
    r")\b"
)

_DIMENSION = re.compile(
    r"\b("
    r"dimension\w*|size|sizes|measurement\w*|measures|abmessung\w*|masse|mass|grosse|artikelmasse"
    r"|produktmasse|taille|mesures|encombrement|dimensioni|misure|misura|ingombro|dimensiones|medidas"
    r"|tamano|dimensoes|dimensao|tamanho|afmeting\w*|maten|formaat|format|formato|\w*abmessung\w*|\w*afmeting\w*"
    r"|gesamtmass\w*|overall|trim size"
    r")\b"
)


#: First parts of German and Dutch compounds such as `Gesamthöhe`, overall height.
_OF_THE_WHOLE = re.compile(
    r"^(gesamt|produkt|artikel|gerate|geraete|mobel|aussen|product|artikel|totaal|buiten)(?=.{4})"
)

_STRIPPED = re.compile(
    r"\b(without|w/o|ohne|sans|senza|sin|sem|zonder) (the )?"
    r"(stand|base|standfuss|fuss|pied|piede|supporto|peana|voet)\b"
)

_BRACKETS = re.compile(r"\([^)]*\)")
_WORD = re.compile(r"[^\W\d_]+")

#: Units and words without information about the measured object.
_SMALL_WORDS = frozenset(
    re.findall(
        r"\w+",
        "the of in and or to for with approx approximate approximately about max maximum total actual nominal net "
        "no not listed piece each per incl including inch inches cm mm dm ft der die das des dem den im und oder von "
        "mit ca circa etwa insgesamt maximale maximaler netto pro stuck produktes gerates artikels le la les du de et "
        "ou en avec env environ par meuble il lo gli del della dei delle dello di da al con e ed mobile el los "
        "las y un una por aprox mueble do dos em com os as het een van met meubel",
    )
)


@_cached
def is_package(label: str) -> bool:
    """Return True if a plain label names the package instead of the item."""
    return bool(_PACKAGE.search(_UNPACKED.sub(" ", label)))


def axis_of_word(word: str) -> str | None:
    """Return the axis of a plain word, which may be a compound: `hohe`, `gesamthohe`, `producthoogte`."""
    return AXIS_WORDS.get(word) or AXIS_WORDS.get(_OF_THE_WHOLE.sub("", word))


@_cached
def names_an_axis(label: str) -> bool:
    """Return True if a plain label contains the name of an axis: `heel height`."""
    return any(axis_of_word(word) for word in _WORD.findall(label))


@_cached
def is_foreign(label: str, title: str = "") -> bool:
    """Return True if a plain label contains a word for another object: `heel height`, `turntable diameter`.

    Words of the plain title belong to the item: a `table height` is the height of a table.
    """
    words = [word for word in _WORD.findall(_ASIDE.sub(" ", _BRACKETS.sub(" ", label))) if len(word) > 1]
    return any(
        not (axis_of_word(word) or word in _SMALL_WORDS or _WHOLE.search(word) or _DIMENSION.search(word))
        and (len(word) <= 2 or word not in title)
        for word in words
    )


@_cached
def is_component(label: str) -> bool:
    """Return True if a plain label names a part, an adjustment or another quantity.

    False for `depth without handles`, `dimensions & weight`, `size (kettle + base)` and `the complete model measures`.
    """
    if is_dimension_label(label) or _ORDER.search(label):
        label = _MOST.sub(" ", _AND_WEIGHT.sub(" ", _TOGETHER.sub(" ", label)))
    return bool(_COMPONENT.search(_COMPLETE.sub(" ", _ASIDE.sub(" ", label))))


@_cached
def is_stripped(label: str) -> bool:
    """Return True if a plain label excludes the stand or base of the item: `without stand`."""
    return bool(_STRIPPED.search(label))


@_cached
def is_part_heading(heading: str) -> bool:
    """Return True if a plain heading announces the size of a part: `seat dimensions`, not `dimensions and weight`."""
    single = not re.search(r"[&,/+]|\b(and|und|et|e|y|en)\b", heading)
    return single and is_dimension_label(heading) and is_component(heading) and not is_whole(heading)


@_cached
def is_part_name(heading: str, title: str) -> bool:
    """Return True if a plain heading is just the name of a part (`seat`) that is not in the plain title."""
    return len(heading.split()) <= 2 and heading not in title and is_component(heading) and not is_whole(heading)


@_cached
def is_of_others(heading: str) -> bool:
    """Return True if a plain heading introduces other products: `you may also like`."""
    return bool(_OTHERS.search(heading))


@_cached
def is_whole(label: str) -> bool:
    """Return True if a plain label refers to the whole item."""
    return bool(_WHOLE.search(label))


@_cached
def is_dimension_label(label: str) -> bool:
    """Return True if a plain label contains a word for a size."""
    return bool(_DIMENSION.search(label))


_SITE_LANGUAGE = {
    "de": "de", "at": "de", "ch": "de", "fr": "fr", "it": "it", "es": "es", "mx": "es", "pt": "pt", "br": "pt",
    "nl": "nl", "uk": "en", "us": "en", "ca": "en", "au": "en", "ie": "en", "com": "en",
}  # fmt: skip


def language_of(declared: str | None, host: str = "") -> Language | None:
    """Return the declared language of a page (`de-DE`), else that of the top-level domain of its host, else None."""
    known: tuple[Language, ...] = ("en", "de", "fr", "it", "es", "pt", "nl")
    for candidate in (
        (declared or "").split("-")[0].split("_")[0].lower(),
        _SITE_LANGUAGE.get(host.rpartition(".")[2]),
    ):
        for language in known:
            if candidate == language:
                return language
    return None
