"""Tracks from parts and blocks are those from tables of all masks by all masks, and take memory by the part."""

import tracemalloc

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.association.point_labels import PointLabels
from estimator.association.proximity import MIN_LARGER_POINTS as MIN_PLACE_POINTS
from estimator.association.proximity import MIN_SMALLER_POINTS as MIN_LYING_POINTS
from estimator.association.proximity import GroupClouds as GroupPlaces
from estimator.association.proximity import relative_distance
from estimator.association.tracks import MIN_COMMON_FRACTION, MIN_JOIN_AFFINITY, MIN_JOIN_IOU, shared_tracks
from estimator.projection.visibility import indicator_matrix, row_indices
from estimator.records.scene import Instance
from tests.support.plain_clustering import plainly_merged

PIXEL = np.ones((1, 1), dtype=bool)


def cloud_of(points, members, seen):
    """Labels of points whose masks hold `members` and whose views see `seen`."""
    inside, visible = indicator_matrix(members, len(points)), indicator_matrix(seen, len(points))
    return PointLabels(points, np.arange(len(points)), inside, visible, visible, inside)


def random_scene(seed):
    """Objects with random masks, wrong names, boxes, holes and points of neighbours, in one or two clouds."""
    random = np.random.default_rng(seed)
    views, objects, each, kinds = (int(random.integers(1, most)) for most in (9, 7, 50, 4))
    centres = random.uniform(-1, 1, (objects, 3)) * random.uniform(0.1, 1.5)
    points = np.concatenate([centre + random.normal(0, 0.2, (each, 3)) for centre in centres])
    shown = [(view, k) for view in range(views) for k in range(objects) if random.random() < 0.7]
    named = [k if random.random() < 0.8 else int(random.integers(3)) for _, k in shown]
    instances = [
        Instance(f"{view}-{k}", view, f"c{name % kinds}", PIXEL, (0, 0), 1.0, bool(random.random() < 0.1))
        for (view, k), name in zip(shown, named, strict=True)
    ]
    clouds, (sight, hit) = [], random.uniform(0.1, 0.9, 2)
    for cloud in range(int(random.integers(1, 3))):
        seen = [np.flatnonzero(random.random(len(points)) < sight) for _ in range(views)]
        members = [
            own[(own // each == k) & (random.random(len(own)) < hit) | (random.random(len(own)) < 0.05)]
            for own, k in ((seen[view], k) for view, k in shown)
        ]
        clouds.append(cloud_of(points + 0.001 * cloud, members, seen))
    return instances, clouds


def full_tables(clouds, views):
    """(4, m, m) of all masks: shared points, the smaller number that both views see, doubt, union."""
    tables = np.zeros((4, len(views), len(views)))
    for cloud in clouds:
        members, visible = cloud.membership.toarray(), cloud.visibility.toarray()
        seen, held = (members @ visible.T)[:, views], members.sum(axis=1)
        shared = members @ members.T
        tables += [shared, np.minimum(seen, seen.T), 0.1 * np.minimum.outer(held, held), seen + seen.T - shared]
    return tables


def plainly_placed(groups, instances, clouds, over, under):
    """The rule of places as it reads: all pairs are inspected again after every join."""
    places = GroupPlaces(
        lambda row: np.concatenate([cloud.points[row_indices(cloud.membership, row)] for cloud in clouds])
    )
    while True:
        best = (1.0, -1, -1)
        for one, first in enumerate(groups):
            for two, second in enumerate(groups):
                pairs, both = np.ix_(first, second), [instances[row] for row in first + second]
                few, many = sorted(places.of(tuple(group)).count for group in (first, second))
                if (
                    one != two
                    and not any(instance.from_box for instance in both)
                    and len({instance.view for instance in both}) == len(both)
                    and few >= MIN_LYING_POINTS
                    and many >= MIN_PLACE_POINTS
                    and over[pairs].sum() >= MIN_COMMON_FRACTION * under[pairs].sum()
                ):
                    apart = relative_distance(places.of(tuple(first)), places.of(tuple(second)))
                    best = min(best, (apart, one, two))
        if best[1] < 0:
            return groups
        first, second = sorted(best[1:])
        groups[first] += groups.pop(second)


def tracks_by_tables(instances, clouds):
    """The tracks from tables of all masks by all masks."""
    views = np.array([instance.view for instance in instances], dtype=np.int64)
    shared, smaller, doubt, union = full_tables(clouds, views)
    groups = []
    for category in sorted({instance.category for instance in instances}):
        rows = np.array([row for row, instance in enumerate(instances) if instance.category == category])
        joined = plainly_merged(rows[:, None].tolist(), views, shared, smaller + doubt, MIN_JOIN_AFFINITY)
        groups += plainly_placed(joined, instances, clouds, shared + doubt, smaller + doubt)
    return [tuple(group) for group in plainly_merged(groups, views, shared, union, MIN_JOIN_IOU)]


@given(seed=st.integers(0, 100_000))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_parts_give_the_tracks_of_the_full_tables(seed):
    instances, clouds = random_scene(seed)
    found = [track.members for track in shared_tracks(instances, clouds)]
    assert found == (tracks_by_tables(instances, clouds) if instances else [])


def test_memory_grows_by_the_object_and_not_by_all_masks_squared():
    """4,000 masks of forty objects of one category: ten tables of all pairs of masks would take 640 MB."""
    each, objects, views = 30, 40, 100
    centres = np.random.default_rng(0).uniform(-3, 3, (objects, 3))
    points = np.repeat(centres, each, axis=0) + np.random.default_rng(1).normal(0, 0.1, (objects * each, 3))
    members = [np.arange(k * each, (k + 1) * each) for _ in range(views) for k in range(objects)]
    instances = [Instance(f"{v}-{k}", v, "cup", PIXEL, (0, 0)) for v in range(views) for k in range(objects)]
    labels = cloud_of(points, members, [np.arange(len(points))] * views)
    tracemalloc.start()
    tracks = shared_tracks(instances, [labels])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(tracks) == objects
    assert peak < 60e6
