"""A branch of periodic orbits: followed both ways within a range, with its bifurcations, and why it ends.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tcc_sim.continuation.palc import null_direction, solution_at
from tcc_sim.continuation.problem import Floats
from tcc_sim.continuation.shooting import Shooting
from tcc_sim.continuation.special_points import Bifurcation, ContinuationPoint, point_at, turned, with_branch
from tcc_sim.continuation.walk import Course, Walk


@dataclass
class Branch:
    """One branch in order along it.

    origin : "start", or the kind and value of the bifurcation it was switched at
    ended : two sentences, one for each end
    """

    period: int
    origin: Any
    points: list[ContinuationPoint]
    ended: tuple[str, str]
    closed: bool = False
    bifurcations: list[Bifurcation] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """As an entry of `branches`."""
        rows = [s.orbit.as_json() for s in self.points]
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        return {"period": self.period, "origin": self.origin, **columns, "ended": list(self.ended),
                "closed": self.closed}


def follow(first: ContinuationPoint, course: Course, origin: Any, number: int, *, both: bool = True, began: str = "",
           keep: list[Branch] | None = None) -> Branch:
    """The branch through `first`, both ways, or only along its tangent.

    began : the sentence for the end it starts at, where only one way is followed
    keep : takes the branch, what there is of it after Ctrl-C too
    """
    branch = Branch(first.orbit.period, origin, [first], (began, ""))
    walks: list[Walk] = []
    try:
        for sign in (1.0, -1.0) if both else (1.0,):
            walks.append(Walk(course, [first if sign > 0.0 else turned(first)]))
            if walks[-1].run().closed:
                break
    finally:
        forward = walks[0]
        backward = walks[1] if len(walks) > 1 else None
        behind = [] if backward is None else [turned(s) for s in backward.points[:0:-1]]
        branch.points = behind + forward.points
        branch.bifurcations = [with_branch(f, number) for w in (backward, forward) if w is not None
                               for f in (w.bifurcations[::-1] if w is backward else w.bifurcations)]
        branch.closed = forward.closed
        ahead = forward.sentence
        if keep is not None:
            keep.append(branch)
        behind_it = backward.sentence if backward is not None else began
        branch.ended = (ahead if forward.closed else behind_it or ahead, ahead)
    return branch


def first_point(shooting: Shooting, z: Floats) -> ContinuationPoint:
    """The point of a solution that no walk has led to; its tangent points to growing parameters."""
    found = shooting.linearise(z)
    tangent = null_direction(found)
    if tangent[shooting.size] < 0.0:
        tangent = -tangent
    return point_at(shooting, solution_at(z, found, tangent))
