# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers of simplification that were found by measuring, in one place, so that tests can hand in others.

What was measured, on 3D-IRCADb-01's abdomen, which is noisy; errors are means of the distances both ways, times are
medians of calls in turn on one thread. First clusters, then edges, against edges alone:

| surface            | triangles | removed | time saved | error added |
| ------------------ | --------- | ------- | ---------- | ----------- |
| bone, 280 HU       |      404k |    90 % |       22 % |       3.7 % |
| bone, 280 HU       |      404k |    95 % |       39 % |       7.1 % |
| bone, 265 HU       |    1,245k |    90 % |       25 % |       1.1 % |
| bone, 265 HU       |    1,245k |    95 % |       37 % |       3.3 % |
| vessels, 140 HU    |    1,164k |    90 % |       10 % |       0.4 % |
| vessels, 140 HU    |    1,164k |    95 % |       20 % |       0.3 % |

So clusters are made where more than 94 % go. Edges of lines at 0.4 of their cost: the median error of a label of a
patient's 61 organs falls by 5 %. Memory for each triangle is tracemalloc's peak on tumors and bone, rounded up.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """Measured settings of simplification. None of them affects its guarantees.

    share, complex_share : float
        Of the edges are looked at in a round: fewer come closer to one heap, and take more rounds. In a complex fewer
        leave more contacts of two labels that are smaller than a triangle.
    poor_round : float
        A round is poor if fewer than this share of the edges tried could collapse.
    poor_rounds : int
        After so many poor rounds in a row, retry refused edges or stop.
    compact_below : float
        Leave out faces that are gone once fewer than this share remain.
    consider_again, cut_again, cut_in_batch : float
        Collapses are so many times more expensive before components are considered again, and before handles are; they
        are fewer, and finding them takes longer. The last pass over batches cuts what is left.
    last : float
        While at most this share of the triangles is too many, handles are not looked for, unless edges get no further.
    test_again, far : float
        Look for crossings when this share of the triangles is left, and `far` times as many as asked for at least;
        nearer to the goal the test at the end is soon enough.
    component_cost : float
        The removal of a component must cost less than this share of a collapse: its gap counts one way only, and noise
        lowers quadrics.
    component_extent : float
        Components up to so many times the maximum error long may go within it.
    component_every, component_probes : int
        One of so many vertices stands for a component when others measure their gap to it, and their number at most
        that measure.
    least_loop : float
        Handles are looked for once loops as long as this share of the median edge may be cut.
    pull : float
        Each of the two loops of a cut moves by this share of the way to its neighbors.
    clustered, left_by_clusters : float
        Make clusters first of so many times as many triangles as are to be left in the end, and until so many times as
        many are left: edges collapse from there on.
    expensive_cluster : float
        A cluster that costs more than so many times the median is not made.
    enough_clusters, least_cluster_gain : float
        No further round of clusters for at most so many times as many triangles as asked for, or after one that leaves
        more than this share.
    safety_factor : float
        Share of a maximum error that samples must keep: between them a surface swings out farther.
    sample_parts, sample_first : int
        Cut a side into so many parts for samples at most. Look at one of so many samples first: most refusals need no
        more.
    spare : float
        Batches leave so many times as many triangles as wanted to the last pass.
    batches, regions : int
        Parts for each `whole_faces` triangles, in the first and in the last pass.
    face_bytes, bounded_face_bytes, complex_face_bytes, bounded_complex_face_bytes : int
        Memory for each triangle at the start: without and with a maximum error, and both of labels that touch.
    held_face_bytes : int
        Of a triangle between the passes: 12, and half a vertex with its normal and number of 64 bits.
    merged : int
        Merge batches that hold more than the triangles that are simplified as a whole divided by this, where that
        halves them.
    merge_face_bytes : int
        Resident memory for each triangle of a merge, at most: 463 and 487 were seen where a quarter and three quarters
        stayed.
    line_share : float
        Of its cost an edge of a line is ordered by: with it three triangles go, and each interface then needs fewer
        along it.
    retry : int
        Rounds after which edges of a complex that were refused are considered again.
    proportional, integral, most_octaves : float
        Octaves of cost for each octave by which a label lags behind, at once and for every round, and at most.
    least_share : float
        A label that is down to this share of its share gives no more.
    """

    share: float = 0.06
    complex_share: float = 0.12
    poor_round: float = 0.05
    poor_rounds: int = 24
    compact_below: float = 0.75
    consider_again: float = 1.2
    cut_again: float = 3.0
    cut_in_batch: float = 6.0
    last: float = 0.01
    test_again: float = 0.25
    far: float = 2.0
    component_cost: float = 0.6
    component_extent: float = 4.0
    component_every: int = 6
    component_probes: int = 4
    least_loop: float = 0.6
    pull: float = 0.1
    clustered: float = 16.0
    left_by_clusters: float = 4.0
    expensive_cluster: float = 8.0
    enough_clusters: float = 1.15
    least_cluster_gain: float = 0.8
    safety_factor: float = 0.75
    sample_parts: int = 15
    sample_first: int = 8
    spare: float = 1.2
    batches: int = 4
    regions: int = 8
    face_bytes: int = 380
    bounded_face_bytes: int = 800
    complex_face_bytes: int = 320
    bounded_complex_face_bytes: int = 1100
    held_face_bytes: int = 36
    merged: int = 2
    merge_face_bytes: int = 490
    line_share: float = 0.4
    retry: int = 10
    proportional: float = 6.0
    integral: float = 0.5
    most_octaves: float = 40.0
    least_share: float = 0.75


POLICY = Policy()
