# SPDX-License-Identifier: GPL-3.0-or-later
"""Collect the numbers of simplification that were found by measuring, so that tests can hand in others.

Clusters first and edges after them were compared with edges only, on 3D-IRCADb-01's abdomen, which is noisy. Errors
are means of the distances both ways; times are medians of alternating calls on one thread.

| surface            | triangles | removed | time saved | error added |
| ------------------ | --------- | ------- | ---------- | ----------- |
| bone, 280 HU       |      404k |    90 % |       22 % |       3.7 % |
| bone, 280 HU       |      404k |    95 % |       39 % |       7.1 % |
| bone, 265 HU       |    1,245k |    90 % |       25 % |       1.1 % |
| bone, 265 HU       |    1,245k |    95 % |       37 % |       3.3 % |
| vessels, 140 HU    |    1,164k |    90 % |       10 % |       0.4 % |
| vessels, 140 HU    |    1,164k |    95 % |       20 % |       0.3 % |

So clusters are made if more than 94 % of the triangles are to go. Ordering the edges of lines by 0.4 of their cost
lowers the median error of a label by 5 %, among 61 organs of a patient. Memory for each triangle is tracemalloc's peak
on tumors, bone and noise, rounded up.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """Measured settings of simplification. None of them affects its guarantees."""

    share: float = 0.06
    """Share of the edges examined in each round. A smaller share follows the order of costs more closely, in more
    rounds."""
    complex_share: float = 0.12
    """The same for labels that touch. A smaller share leaves more contacts that are smaller than a triangle."""
    passes: int = 3
    """Passes in which a round selects edges whose triangles do not meet."""
    poor_round: float = 0.05
    """A round is poor if fewer than this share of its edges could collapse."""
    poor_rounds: int = 24
    """After this number of poor rounds in a row, retry refused edges or stop."""
    compact_below: float = 0.75
    """Drop deleted faces once fewer than this share remain."""
    least_turn: float = 0.2
    """A triangle may turn by at most the angle with this cosine."""
    thinnest: float = 0.0
    """Refuse collapses that make a triangle's height a smaller share of its longest side, and smaller than it was."""

    consider_again: float = 1.2
    """Consider components again once collapses cost this many times as much."""
    cut_again: float = 3.0
    """Look for handles again once collapses cost this many times as much: there are few, and the search is slow."""
    cut_in_batch: float = 6.0
    """The same in a batch: the last pass cuts what is left."""
    last: float = 0.01
    """Look for no handles while at most this share of the triangles is too many, unless rounds are poor."""
    test_again: float = 0.25
    """Look for crossings once this share of the triangles remains."""
    far: float = 2.0
    """Leave that test to the end below this many times the triangles asked for."""
    component_cost: float = 0.6
    """Remove a component if that costs less than this share of a collapse: its gap counts one way only, and noise
    lowers quadrics."""
    component_extent: float = 4.0
    """A component that is longer than this many times the maximum error cannot lie within it."""
    component_every: int = 6
    """One of this number of a component's vertices is a point that others measure their gap to."""
    component_probes: int = 4
    """A component measures its gap at this number of its vertices at most."""
    least_loop: float = 0.6
    """Look for handles once loops as long as this share of the median edge may be cut."""
    sampled_edges: int = 16
    """One of this number of edges is measured for that median."""
    most_loop_faces: int = 64
    """A vertex of a loop has at most this many faces on one side of it."""
    pull_halvings: int = 8
    """Halve the next share this number of times at most where a triangle would turn over."""
    pull: float = 0.1
    """Each of the two loops of a cut moves by this share of the way to its neighbors."""

    clustered: float = 16.0
    """Make clusters first if there are more than this many times the triangles asked for."""
    left_by_clusters: float = 4.0
    """Clusters leave this many times the triangles asked for, and edges collapse from there on."""
    cluster_passes: int = 3
    """Passes in which a round chooses the seeds of clusters."""
    expensive_cluster: float = 8.0
    """Leave a cluster alone if it costs more than this many times the median."""
    enough_clusters: float = 1.15
    """End the rounds of clusters at this many times the triangles that clusters leave."""
    least_cluster_gain: float = 0.8
    """End them too after a round that leaves more than this share."""

    safety_factor: float = 0.75
    """Samples keep this share of a maximum error: between them a surface swings out farther."""
    sample_parts: int = 15
    """A side is cut into this number of parts for samples at most."""
    sample_first: int = 8
    """Examine one of this number of samples first: most refusals need no more."""
    steep: float = 0.5
    """The check of a maximum error takes distances to grow by this much along a piece at most: the sine of 30
    degrees."""
    quarterings: int = 5
    """That check cuts a triangle in four this number of times at most."""
    nearer_steps: int = 2
    """Go this number of triangles in search of a nearer one before the tree is asked."""

    spare: float = 1.2
    """Batches leave this many times the triangles asked for to the last pass."""
    batches: int = 4
    """A batch has the triangles that are simplified as a whole, divided by this."""
    regions: int = 8
    """A region of the last pass has the triangles that are simplified as a whole, divided by this."""
    first_error_share: float = 0.8
    """Batches use this share of a maximum error, and the last pass the rest."""
    least_gain: float = 0.1
    """Simplify everything at once after a pass over regions that removed less than this share of its excess."""
    later_volume: float = 0.5
    """Multiply the largest volume that may go by this in later passes, which judge components by their boxes."""
    merged: int = 2
    """Merge batches once they hold the triangles that are simplified as a whole, divided by this, if that halves
    them."""

    face_bytes: int = 380
    """Memory for each triangle at the start."""
    bounded_face_bytes: int = 900
    """The same with a maximum error."""
    complex_face_bytes: int = 320
    """Memory for each triangle of labels that touch."""
    bounded_complex_face_bytes: int = 1100
    """The same with a maximum error."""
    held_face_bytes: int = 36
    """Memory for each triangle between the passes: 12, and half a vertex with its normal and its number of 64 bits."""
    merge_face_bytes: int = 490
    """Resident memory for each triangle of a merge: it was 463 and 487 where a quarter and three quarters stayed."""
    thread_factor: int = 4
    """Another thread takes this many times the memory of a batch, with batches that wait and freed memory that malloc
    keeps: a foam took 0.31 GiB on one thread and 0.69 GiB on two."""
    seam_faces: int = 4
    """Triangles that stay for each vertex of a batch's two seams."""

    line_share: float = 0.4
    """Order an edge of a line by this share of its cost: three triangles go with it, and each interface then needs
    fewer along it."""
    gap_rings: int = 4
    """Examine this number of rings of triangles around a line for gaps: a gap of a few samples has no more."""
    retry: int = 10
    """Retry the refused edges of a complex after this number of rounds."""
    proportional: float = 6.0
    """Octaves of cost for each octave by which a label lags behind."""
    integral: float = 0.5
    """Octaves of cost that each such round adds for good."""
    most_octaves: float = 40.0
    """Largest number of octaves by which costs of a label are multiplied."""
    least_share: float = 0.75
    """A label that is down to this share of its share gives no more."""


POLICY = Policy()
SOLIDS = Policy(thinnest=2.0**-13)
"""For parts of solids, which have flat sides. At 2^-10 and more, triangles that are thin at first stay in clusters."""
