"""The verbs of `tcc-sim`: their lines in `--help`, and an example, the printed lines and the files of each."""

from __future__ import annotations

from dataclasses import dataclass

from tcc_sim.output.terminal import terminal_width, wrapped


@dataclass(frozen=True)
class Verb:
    """One verb, as `--help` describes it.

    line : its purpose, in the manner of a sentence without a capital and a full stop
    example : words after `tcc-sim`
    prints, writes : contents of standard output, and the files with the options that name them
    takes : computing time of a verb that runs for minutes
    """

    line: str
    example: str = ""
    prints: str = ""
    writes: str = ""
    takes: str = ""

    def description(self) -> str:
        """Return the line as a sentence, no wider than the terminal."""
        return wrapped(f"{self.line[0].upper()}{self.line[1:]}.", terminal_width())

    def epilog(self) -> str:
        """Return the end of the verb's help, no wider than the terminal."""
        takes = f"\ntakes:    {self.takes}" if self.takes else ""
        return wrapped(f"example:  tcc-sim {self.example}\nprints:   {self.prints}\nwrites:   {self.writes}{takes}",
                       terminal_width())


_JSON = "--json FILE holds all numbers"
_PICTURE = "--plot FILE a picture"

GROUPS: dict[str, dict[str, Verb]] = {
    "demonstration": {
        "demo": Verb(
            "run nodes, recorder and controller on ROS 2, analyse the recording and draw it",
            "demo --scene controlled --duration 5 --out run1",
            "the summary of the recorded motion and the next commands to try",
            "the directory --out with recording/, analysis.json, run.rrd (Rerun) and overview.png")},
    "scenes": {
        "scenes": Verb(
            "list the bundled scenes",
            "scenes --show fig02",
            "name and description of each scene; with --show the parameter file of one scene",
            "no file; scenes --show fig02 > mine.yaml makes a scene to edit"),
        "explain": Verb(
            "estimate how a scene behaves, and list the terms of its equations",
            "explain fig02",
            "natural frequencies, torques, critical slope, friction law, closed forms, terms in use and left out",
            f"{_JSON}, --plot FILE a picture of the friction law")},
    "steady states": {
        "simulate": Verb(
            "solve a scene and summarise its steady state",
            "simulate fig02 --plot fig02.png",
            "largest slip speed, regime, period, section points, heat and shaft torque, and the figures asked for",
            f"{_JSON}, --out FILE the samples, {_PICTURE}"),
        "sweep": Verb(
            "solve a scene at many values of one key or two",
            "sweep fig02 --over engine.frequency=40:300:131 --cycles 600 --discard 500 --plot sweep.png",
            "one line for each value, or quantiles with --scatter; with --json or --out only the number of values",
            f"{_JSON}, --out FILE each point as soon as it is solved, {_PICTURE}"),
        "linearise": Verb(
            "give the transfer function from pressure or engine torque about a settled motion",
            "linearise controlled --slip 20 --controller 3,11.25 --plot bode.png",
            "operating point, multipliers, gain and phase at seven frequencies, and the margins of a controller",
            f"{_JSON}, --out FILE the arrays, {_PICTURE}")},
    "recordings": {
        "analyse": Verb(
            "summarise a recording, show it in Rerun, solve it again",
            "analyse run1 --verify --plot run1.png",
            "contents and losses of the recording, the summary of its motion, and the figures asked for",
            f"{_JSON}, --out FILE the samples, --rrd FILE a Rerun recording, {_PICTURE}"),
        "recover": Verb(
            "make a complete, indexed bag from a recording that was cut short or damaged",
            "recover run1 --out run1_whole",
            "recovered messages by topic, and the parts that are missing",
            "the directory --out with the new bag; the old one stays unchanged"),
        "import": Verb(
            "write a bag in SQLite, of ROS 1 or of another program as a recording",
            "import lab.db3 run1 --joints flywheel=engine,clutch_plate=turbine",
            "number of states and runs, losses, and what the bag does not state",
            "the directory RUN with the new bag; the old one stays unchanged"),
        "identify": Verb(
            "estimate parameters of a scene from a recording or a table of measurements",
            "identify run1 --free friction.kinetic_coefficient --out mine.yaml --plot fit.png",
            "value, standard error and verdict for each free key",
            f"{_JSON}, --out FILE the scene with the estimated values, {_PICTURE}")},
    "running nodes": {
        "watch": Verb(
            "show running nodes live in Rerun",
            "watch --rrd live.rrd",
            "after Ctrl-C, the number of states shown and missed",
            "--rrd FILE a Rerun recording; otherwise nothing"),
        "control": Verb(
            "reset, pause, step or command a running driveline, and get or set its parameters",
            "control set pressure.mean=230000 engine.mean_torque=310",
            "the answer of the node",
            "no file")},
    "pictures": {
        "plot": Verb(
            "draw the result in a .json or .npz file of another verb again",
            "plot run.json --plot run.pdf --width column",
            "the name of the picture",
            "--plot FILE, the picture")},
    "other programs": {
        "fmu": Verb(
            "export the real-time step of a scene in C as a co-simulation FMU",
            "fmu controlled --fmi 3 --out clutch.fmu",
            "the name of the FMU and its contents",
            "--out FILE, the FMU")},
    "motions and methods": {
        "continue": Verb(
            "follow periodic motions along a key, stable or unstable, with their bifurcations",
            "continue chaos --over friction.kinetic_coefficient=0.2:0.3 --switch --plot branches.png",
            "branches, the reasons for their ends, and bifurcations",
            f"{_JSON}, {_PICTURE}"),
        "basins": Verb(
            "find attractors and their basins in a plane of two initial conditions",
            "basins chaos --plane initial.slip_speed=-40:40:41 --plane initial.plate_angle=0:0.2:41 --plot basins.png",
            "attractors with the share of the plane that leads to each",
            f"{_JSON}, --out FILE the label of each cell, {_PICTURE}")},
    "the paper": {
        "figure": Verb(
            "draw figures of the paper and write their numbers",
            "figure 6 --branches",
            "the name of each picture and its computing time",
            "figNN.png, figNN.svg and figNN.json in the directory --out"),
        "claims": Verb(
            "judge the claims of the paper",
            "claims --pressures 225 --markdown claims.md",
            "each claim with its verdict and numbers, then the number of claims for each verdict",
            "--json FILE, --markdown FILE and --errata FILE the tables, --kept FILE progress, to resume from",
            "8 to 10 minutes of processor time per pressure, half an hour for all three; 10 minutes more with "
            "--thresholds")},
    "measurements of the program": {
        "precision": Verb(
            "measure error against run time of every solver",
            "precision --quick",
            "error and run time for each scene and solver",
            "the directory --out with precision.png, .svg, .json and .md"),
        "stability": Verb(
            "try every solver on stiff and extreme scenes",
            "stability --quick",
            "number of scenes by outcome for each solver",
            "the directory --out with stability.png, .svg, .json and .md"),
        "realtime": Verb(
            "compare the pacing of the driveline node with a bare absolute-deadline loop",
            "realtime --rate 1000 --duration 10 --json realtime.json",
            "missed ticks, drift, and lateness and CPU time of both loops",
            "--json FILE, all numbers")},
}
"""Verbs by purpose, in the order of `tcc-sim --help`."""
VERBS: dict[str, Verb] = {name: verb for verbs in GROUPS.values() for name, verb in verbs.items()}
"""Every verb by its name."""


def verbs_by_purpose() -> str:
    """Return every verb with its line below the title of its group, no wider than the terminal."""
    width = max(map(len, VERBS))
    lines = [line for title, verbs in GROUPS.items()
             for line in (f"{title}:", *(f"  {name:<{width}}  {verb.line}" for name, verb in verbs.items()))]
    return wrapped("\n".join(lines), terminal_width())
