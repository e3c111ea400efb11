"""Names of the registered problems that are Lagrangian systems, all of them, as test_lagrangian_problems.py says."""

LAGRANGIAN = (
    "pendulum-xy", "pendulum-and-wall", "double-pendulum-stop", "rod-on-pin", "pendulum-cradle", "kane-pendulum",
    "rocking-block-bodies", "squat-block", "block-on-corners", "ball-with-spin", "rolling-disc", "disc-in-bowl",
    "falling-rod", "tipping-plank", "tumbling-rod", "bouncing-dimer", "painleve-rod", "painleve-jam", "wedge-billiard",
    "rotating-box", "slider-crank", "guided-slider-crank", "coupled-linkages", "rod-chain", "woodpecker-bodies",
)  # fmt: skip
