"""The stages in their order."""

from rovtwin.commission import bench, certificate, estimate, excite, paper, predict, prove, scale
from rovtwin.commission.dip import stage as dip
from rovtwin.commission.drill import stage as drill
from rovtwin.commission.stage import Stage

STAGES: tuple[Stage, ...] = (
    Stage(
        "paper",
        "Paper",
        "what parts, geometry and formulas say, before anything gets wet",
        "Put the vehicle beside the tank, switched on, and start the bench test.",
        False,
        paper.run,
        connects=False,
    ),
    Stage(
        "bench",
        "Bench",
        "link, sensors, clocks, noise at rest and battery, thrusters off",
        "Put the vehicle into the middle of the tank, well below the surface, hands on it.",
        False,
        bench.run,
    ),
    Stage(
        "dip",
        "Dip",
        "each thruster in turn at small command: does the vehicle move as its file says?",
        "Leave the vehicle in the middle of the tank, and keep hands away.",
        True,
        dip.run,
    ),
    Stage(
        "drill",
        "Fail-safe drill",
        "STOP, a program that falls silent and a line that is cut, each with its time to thrusters off",
        "Have a scale or a known ballast mass ready.",
        True,
        drill.run,
    ),
    Stage(
        "scale",
        "Scale",
        "what newtons are, by a pull on a scale",
        "Take the line off, put the vehicle into the middle of the tank, and start the test.",
        True,
        scale.run,
    ),
    Stage(
        "excite",
        "Excite",
        "the planned test, in parts, until damping is known as well as was asked for",
        "Take the vehicle out or leave it; the estimate needs nobody.",
        True,
        excite.run,
    ),
    Stage(
        "identify",
        "Identify",
        "all parameters with intervals, whether the tests repeat, the uncertainty budget",
        "Read the page, then let the autopilot be tuned and proven on the twin.",
        False,
        estimate.run,
        connects=False,
    ),
    Stage(
        "prove",
        "Prove on the twin",
        "in which currents and seas missions succeed, whatever the tests left open of the vehicle",
        "Put the vehicle into the tank, clear of walls, ready to be flown.",
        False,
        prove.run,
        connects=False,
    ),
    Stage(
        "predict",
        "Predict, then fly",
        "whether a flight of four corners is as the twin predicted it, written down before",
        "Print the certificate and keep the folder.",
        True,
        predict.run,
    ),
    Stage(
        "certificate",
        "Certificate",
        "all figures on one page, and the evidence in a bundle that another machine can check",
        "Sign the certificate, keep the bundle, and check later dives against it with `rovtwin watch`.",
        False,
        lambda work: certificate.run(work, STAGES[:-1]),
        connects=False,
    ),
)
