"""Touch test: the ball on the tool seated in sockets."""

from analysis.procedures.facts import Facts, Labels

FACTS = Facts(
    of_places=True,
    constants_apart=True,
    setup_terms=6,
    frame_terms=3,
    # For a ball seated by hand: a model of constants, gravity and curves leaves 0.1 to 0.2 mm for two Pandas and an
    # iiwa (Franzese et al., MUKCa, 2024). The readings refine this value. If it starts too low, scatter is mistaken for
    # errors of the arm.
    assumed_sd_mm=0.1,
)
LABELS = Labels(
    example=("rms_mm", 0.5, 1.0),
    part="touch",
    further=("touch", "one place in many postures, without gauges"),
    setup="the places of the sockets and of the ball on the tool",
    no_repeats=(
        "no posture was touched twice, so the scatter of a seated ball is estimated from the residuals of the model; "
        "touch some postures twice"
    ),
    no_scale=(
        "no distance between two sockets is stated, so a common scale of all lengths is uncertain; measure one, write "
        "tests.touch.distances in the rig file, and diagnose with --rig FILE"
    ),
    rows="touches",
    joints_fit="touches return to their sockets",
    distance_from="from its socket",
    outlier_check="check that the ball was seated when the joints were read, and that nothing moved",
)
