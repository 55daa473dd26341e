"""No insertion duplicates a synset of WordNet: all insertions, and the leaves of label lists."""

from collections import defaultdict
from functools import cache

import pytest

from taxonomy.categories import PREFIX
from taxonomy.matching.lexicon import Lexicon, default_lexicon
from taxonomy.matching.sense_choice import DOMAINS, fits
from taxonomy.words.spelling import fold_text, singulars

#: WordNet has the word but means something else, or lumps what differs in size (docs/explanation/taxonomy.md).
HOMONYMS = frozenset(
    "mt:" + name
    for name in [
        "barbet_dog",
        "bean_bag",
        "bed_frame",
        "blue_jacaranda",
        "c_battery",
        "chinook_dog",
        "coach_bus",
        "compote_dish",
        "crossover",
        "cup_and_saucer",
        "divan_bed",
        "english_cocker_spaniel",
        "gas_hob",
        "intaglio_gem",
        "medallion",
        "plaque",
        "playground_ball",
        "podium",
        "roller_bearing",
        "round_table",
        "runabout_boat",
        "scarab_amulet",
        "vinaigrette_box",
    ]
)

#: An object below the parent is called by some of the words of the name, but is another object or a wider one.
WIDER = frozenset(
    "mt:" + name
    for name in [
        "amulet_ornament",
        "auto_rickshaw",
        "baby_carrier",
        "baby_gate",
        "ball_pit",
        "bar_cart",
        "bar_table",
        "barrel_planter",
        "basset_fauve_de_bretagne",
        "bearded_collie",
        "bike_trailer",
        "board_game_set",
        "bottom_freezer_refrigerator",
        "cake_pan",
        "canary_island_date_palm",
        "card_game_set",
        "cavalier_king_charles_spaniel",
        "chef",
        "chemical_tanker",
        "christmas_bauble",
        "cigarette_pack",
        "digital_piano",
        "dog_bowl",
        "doll_accessory",
        "doll_furniture",
        "dress_up_hat",
        "dressing_glass",
        "duvet_cover",
        "electric_juicer",
        "false_olive",
        "fire_pit",
        "folio_sheet",
        "game_piece",
        "grand_basset_griffon_vendeen",
        "handheld_game",
        "hong_kong_orchid_tree",
        "hot_water_jug",
        "ice_cream_maker",
        "ice_cream_scoop",
        "irish_red_and_white_setter",
        "laptop_bag",
        "lego_brick",
        "litter_box",
        "loaf_pan",
        "magnetic_doll",
        "miniature_bull_terrier",
        "nail_clippers",
        "newspaper_box",
        "parking_garage",
        "passenger_coach",
        "pet_carrier",
        "petit_basset_griffon_vendeen",
        "portable_toilet",
        "portrait_miniature",
        "quad_bike",
        "red_flowering_gum",
        "roasting_pan",
        "salt_pepper_shakers",
        "scratching_post",
        "server",
        "soccer_player",
        "sofa_armrest",
        "street_cabinet",
        "sugar_caster",
        "swing_set",
        "textile_panel",
        "top_freezer_refrigerator",
        "wall_plaque",
        "water_polo_ball",
        "water_tank_steamer",
        "weeping_fig",
        "wheelchair_user",
    ]
)

#: Ends the ids of coins by their worth: WordNet has the cent and the dollar.
COIN = "_coin"

#: Words that join others and tell nothing apart.
JOINTS = {"of", "the", "and", "s"}


@pytest.fixture(scope="module")
def lexicon(wordnet) -> Lexicon:
    assert wordnet.knows("chair.n.01")
    return default_lexicon()


@cache
def nouns() -> dict[str, set[str]]:
    """WordNet's nouns by their folded spelling, and by that without spaces."""
    spelt = defaultdict(set)
    for noun in default_lexicon().wordnet.nouns:
        folded = fold_text(noun)
        spelt[folded].add(noun)
        spelt[folded.replace(" ", "")].add(noun)
    return spelt


def senses(spelling: str) -> set[str]:
    """Senses of the nouns with this folded spelling; reading the senses of all nouns would take ten seconds."""
    wordnet = default_lexicon().wordnet
    return {sense for noun in nouns().get(spelling, ()) for sense in wordnet.senses(noun)}


@cache
def names_below(concept: str) -> set[frozenset[str]]:
    """The words of every name of every synset below one."""
    wordnet = default_lexicon().wordnet
    synsets, level = set(), {concept}
    while level:
        level = {child.name() for above in level for child in wordnet.synset(above).hyponyms()} - synsets
        synsets |= level
    return {words(lemma) for synset in synsets for lemma in wordnet.lemmas(synset)}


@cache
def words(name: str) -> frozenset[str]:
    """The words of a name, plurals as their singulars, without those that join."""
    return frozenset(next(iter(singulars(word)), word) for word in fold_text(name).split()) - JOINTS


def synset_above(concept: str, lexicon: Lexicon) -> str:
    """The nearest synset that an insertion was put under."""
    return next(above for above in lexicon.hypernyms(concept) if not above.startswith(PREFIX))


def namesakes(lexicon: Lexicon) -> set[str]:
    """Ids of ours whose name, as it is, singular, in one word or in American spelling, WordNet has for an object."""
    found = set()
    for one in lexicon.inserted.values():
        name = fold_text(one.name)
        spellings = {name, *singulars(name), name.replace(" ", ""), *singulars(name.replace(" ", ""))}
        if any(fits(lexicon.sense(sense), DOMAINS["objects"]) for spelling in spellings for sense in senses(spelling)):
            found.add(one.id)
    return found


def partly_named(lexicon: Lexicon) -> set[str]:
    """Ids of ours below whose parent WordNet has an object with some of the same words, or all in another order."""
    found = set()
    for one in lexicon.inserted.values():
        own = words(one.name)
        parent = synset_above(one.id, lexicon)
        of_parent = {words(lemma) for lemma in lexicon.wordnet.lemmas(parent)}
        if any(other and other <= own and other not in of_parent for other in names_below(parent)):
            found.add(one.id)
    return found


@pytest.mark.slow
def test_the_check_finds_what_a_reader_found(lexicon) -> None:
    """Ids that were taken out for it: in one word, in another order, with a word more."""
    from taxonomy.categories import InsertedCategory

    gone = {
        "mt:jam_pot": ("jam pot", "pot.n.01"),
        "mt:party_favour": ("party favour", "keepsake.n.01"),
        "mt:night_light": ("night lights", "lamp.n.02"),
        "mt:belgian_malinois": ("Belgian malinois", "belgian_sheepdog.n.01"),
        "mt:soap_bar": ("bar of soap", "soap.n.01"),
    }
    inserted = {key: InsertedCategory(id=key, name=name, parent=parent) for key, (name, parent) in gone.items()}
    small = Lexicon(lexicon.wordnet, inserted)
    assert namesakes(small) | partly_named(small) == set(gone)


def test_wordnet_lacks_what_bears_an_id_of_ours(lexicon) -> None:
    assert namesakes(lexicon) == HOMONYMS


def test_nothing_below_the_parent_has_the_same_words(lexicon) -> None:
    found = {one for one in partly_named(lexicon) - HOMONYMS if not one.endswith(COIN)}
    assert found == WIDER
