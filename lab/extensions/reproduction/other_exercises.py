"""Texts of the exercises of Mahdadi and Bouafia 2020, Benmisra 2007, and the thesis on the RX 130."""

from functools import partial

from lab.extensions.reproduction.item import Exercise
from lab.extensions.reproduction.models import arm_sketch

__all__ = ["ELASTIC_EXERCISES", "STAUBLI_EXERCISES", "THESIS_EXERCISES"]

_DISTAL = (
    "A link's matrix is Rot(z, θ) · Trans(z, d) · Trans(x, a) · Rot(x, α): z of frame i lies along the axis of joint "
    "i + 1."
)
_SHORTHAND = "Shorthand: c1 and s1 are cos q1 and sin q1, c23 is cos(q2 + q3)."
_IRB120_TABLE = (
    ("link", "θ", "d (mm)", "a (mm)", "α (°)"), ("1", "q1", "290", "0", "−90"), ("2", "q2 − 90°", "0", "270", "0"),
    ("3", "q3", "0", "70", "−90"), ("4", "q4", "302", "0", "90"), ("5", "q5", "0", "0", "−90"),
    ("6", "q6 + 180°", "72", "0", "0"),
)  # fmt: skip
_ZERO = partial(arm_sketch, "irb120", (0, 0, 0, 0, 0, 0))
_POSE = (
    "The hand's pose has the columns n, o, a of its rotation and the place p, with the components nx, ny, nz, and so "
    "on.",
)

THESIS_EXERCISES = {
    "Figure III.1": Exercise(
        "The ABB IRB 120 has its shoulder, the axis of joint 2, 290 mm above the base's foot. Its upper arm is 270 mm "
        "long, "
        "and the wrist's centre lies 302 mm along and 70 mm across from the elbow. How far from axis 1 does the "
        "wrist's "
        "centre reach, in mm? And how far below the foot, if joint 2 goes to 110° and the forearm then hangs straight "
        "down?",
        "The elbow and the wrist's centre are the ends of the hypotenuse of 302 and 70 mm. At 110° the upper arm "
        "points 20° "
        "below the horizontal.",
        (
            "From elbow to wrist's centre: √(302² + 70²) = 310.0 mm. Stretched out: 270 + 310.0 mm.",
            "At 110° the elbow is 290 + 270 cos 110° = 197.7 mm above the foot. The forearm takes off 310.0 mm.",
        ),
        sketch=_ZERO,
    ),
    "Equations III.1, III.2, III.5, IV.10": Exercise(
        "In the distal convention (the standard one) a link is described by θ, d, a and α. Write the matrix T, 4 by "
        "4, of "
        "the frame of a link in the frame of the link before.",
        "Multiply the four matrices from left to right. The last row is 0, 0, 0, 1.",
        (
            "Rot(z, θ) Trans(z, d): the turn by θ, and the place (0, 0, d).",
            "Trans(x, a) moves by a along the turned x: the place is (a cos θ, a sin θ, d).",
            "Rot(x, α) mixes the second and third columns: cos α times the second plus sin α times the third, and so "
            "on.",
        ),
        ("T is the product Rot(z, θ) · Trans(z, d) · Trans(x, a) · Rot(x, α).", "Letters: θ, d, a, α, or theta, "
        "alpha."),
    ),
    "Table III.2": Exercise(
        "Find the Denavit-Hartenberg table of the ABB IRB 120 in the distal convention, for frames as given: of each "
        "link "
        "θ − q (the constant part of θ), d, a and α.",
        "θ and d lead about and along z, then a and α along and about x. The lengths are 290, 270, 70, 302 and 72 mm.",
        (
            "Link 1: 290 mm up along z0; z1 = y0 is a turn about x by −90°.",
            "Link 2: x turns from forward to up, θ − q = −90°; 270 mm along it; z2 is parallel to z1.",
            "Link 3: 70 mm further up, and z3 points forward: −90°.",
            "Link 4: 302 mm along z3; z4 = −y3 is +90°. Link 5: z5 = y4 is −90°.",
            "Link 6: 72 mm along z5; x6 points against x5: θ − q = 180°.",
        ),
        (_DISTAL,
         "With all joints at zero: axis 1 is vertical, and x0 points forward. Axis 2 is horizontal, 290 mm up, z1 "
         "along y0. "
         "The upper arm points up, 270 mm to axis 3, which is parallel to axis 2; x2 points up. Axis 4 is horizontal, "
         "70 mm above axis 3, and points forward; the wrist's centre is 302 mm along it, where axes 4, 5 and 6 meet.",
         "x3 and x4 point up as x2 does, z4 against y3, z5 along y4. The flange is 72 mm beyond the wrist's centre, "
         "and x6 "
         "points down."),
        sketch=_ZERO,
    ),
    "Equations III.6 to III.11": Exercise(
        "Write the six link matrices T0,1 to T5,6 of the ABB IRB 120 from its table, lengths in mm.",
        "Put each row of the table into the matrix of a link. Joint 2 is offset by −90°: cos(q2 − 90°) = s2.",
        (
            "T = [cos θ, −sin θ cos α, sin θ sin α, a cos θ; sin θ, cos θ cos α, −cos θ sin α, a sin θ; 0, sin α, cos "
            "α, d; "
            "0, 0, 0, 1].",
            "With α = −90°, cos α is 0 and sin α is −1; with α = 90° it is 1.",
            "Link 2: θ = q2 − 90°, so cos θ = s2 and sin θ = −c2. Link 6: θ = q6 + 180° changes both signs.",
        ),
        (_DISTAL, _SHORTHAND), _IRB120_TABLE, _ZERO,
    ),
    "Equation III.12": Exercise(
        "Find the pose T0,6 of the flange of the ABB IRB 120 with all joints at zero: 4 by 4, place in mm.",
        "Multiply the link matrices, or look at the arm: the upper arm points up, the forearm forward.",
        (
            "Up: 290 + 270 + 70 = 630 mm. Forward: 302 + 72 = 374 mm. Nothing sideways.",
            "z6 points forward, along x0: the third column is (1, 0, 0).",
            "x6 points down: the first column is (0, 0, −1). y6 = z6 × x6 is (0, 1, 0).",
        ),
        (_DISTAL,), _IRB120_TABLE, _ZERO,
    ),
    "Equation III.13": Exercise(
        "Find the pose T0,6 of the flange of the ABB IRB 120 with the joints at 0, 0, −90, −90, 90 and −90°: 4 by 4, "
        "place "
        "in mm.",
        "Multiply the link matrices, or turn the arm joint by joint: at −90° joint 3 turns the forearm up.",
        (
            "q3 = −90° turns the forearm from forward to up: the wrist's centre is at 290 + 270 + 302 = 862 mm, and "
            "70 mm "
            "behind axis 1.",
            "q4 and q5 turn the hand sideways: it points against y0, so the flange is at y = −72 mm.",
            "z6 = (0, −1, 0). q6 turns x6 to (−1, 0, 0), and y6 = z6 × x6 = (0, 0, −1).",
        ),
        (_DISTAL,), _IRB120_TABLE, partial(arm_sketch, "irb120", (0, 0, -90, -90, 90, -90)),
    ),
    "Equation III.15": Exercise(
        "The pose T0,6 has the columns n, o, a of its rotation and the place p. Write its inverse, 4 by 4. A text "
        "prints it "
        "as T0,6 = T0,6⁻¹: what should stand on the left side, and what is entry (4,4) of a pose?",
        "The inverse of a rotation is its transpose. The place is what makes the product the identity.",
        (
            "The inverse of the pose of frame 6 in frame 0 is the pose of frame 0 in frame 6.",
            "Its rotation is transposed: the rows are n, o, a.",
            "Its place is minus the transposed rotation times p: minus n · p, o · p, a · p.",
            "The last row is 0, 0, 0, 1.",
        ),
        (*_POSE, "Write the equation as in: T1,0 = T0,1^-1."),
    ),
    "Equations III.18, III.19": Exercise(
        "Find the wrist's centre of the ABB IRB 120 in mm: first x, y, z in the base's frame by q1, q2, q3; then xp, "
        "yp, zp "
        "by the hand's pose, counted from the shoulder, 290 mm above the base.",
        "Add upper arm and forearm in the vertical plane of q1. The wrist's centre lies 72 mm behind the flange, "
        "along the "
        "hand's third column a.",
        (
            "q2 leans the upper arm forward: outwards 270 s2, up 270 c2.",
            "At q2 + q3 = 0 the wrist's centre is 302 mm in front of the elbow and 70 mm above: outwards 302 c23 + 70 "
            "s23, "
            "up 70 c23 − 302 s23.",
            "q1 divides the outward part into x and y. z begins at 290 mm.",
            "By the pose: p − 72 a, and 290 mm less in z.",
        ),
        (*_POSE, "Letters: q1, q2, q3; px, py, pz, ax, ay, az. " + _SHORTHAND), _IRB120_TABLE, _ZERO,
    ),
    "Equations III.21 to III.28": Exercise(
        "The wrist's centre of the ABB IRB 120 is known, and q1. Solve for q3 and q2: write the right sides of the "
        "equations, with the left sides as named in the answers.",
        "Square both equations for A s2 + B c2 and B s2 − A c2 and add them: q2 falls out, and a sine and a cosine of "
        "q3 "
        "are left. Their amplitude is √(70² + 302²).",
        (
            "Outwards: 302 c23 + 70 s23 + 270 s2 = C becomes A s2 + B c2 = C. Up: 70 c23 − 302 s23 + 270 c2 = −D "
            "becomes "
            "B s2 − A c2 = D.",
            "A² + B² = C² + D² = r², and A² + B² = 270² + 70² + 302² + 540 (70 c3 − 302 s3). So "
            "−302 s3 + 70 c3 = r²/540 − 42251/135. Half of the left side is −151 s3 + 35 c3.",
            "302 s3 − 70 c3 = √(70² + 302²) sin(θ3 − β) with tan β = 70/302.",
            "The two equations are linear in s2 and c2: multiply by A and B and add, then by B and −A.",
        ),
        ("r is the distance of the wrist's centre from the shoulder, C its horizontal distance from axis 1 in the "
        "plane of "
         "q1, and D its depth below the shoulder (−zp).",
         "A = −302 s3 + 70 c3 + 270 and B = 302 c3 + 70 s3, in mm. tan β = 70/302.",
         "III.24 and the equation before III.25 are wanted in r, and in s3 and c3. Letters: A, B, C, D, r, s3, c3."),
        _IRB120_TABLE, _ZERO,
    ),
    "Equations III.30, III.31": Exercise(
        "Joints 1 to 3 of the ABB IRB 120 are known, and the hand's rotation with the columns n, o, a. Find q4, q5 and "
        "q6. Write first the five products of wrist angles, as named in the answers, by the entries of the rotation; "
        "then the angles. In q4 and q6 you may use s5.",
        "Turn the hand's columns back into frame 3. Of T3,6 one entry is the cosine of q5 alone, and those beside it "
        "give q4 "
        "and q6.",
        (
            "Frame 3 has the axes: x3 = (c1 s23, s1 s23, c23), y3 = (s1, −c1, 0), z3 = (c1 c23, s1 c23, −s23).",
            "T3,6 is the product of the last three link matrices: its third column is (−c4 s5, −s4 s5, c5), its last "
            "row "
            "(−c6 s5, s6 s5, c5).",
            "Compare with the products of x3, y3, z3 with a, and of z3 with n and o.",
            "c5 gives θ5 up to its sign w. Divided by s5, the others give θ4 and θ6 by atan2.",
        ),
        (*_POSE, "w is the sign of sin θ5, 1 or −1: you may use it, or choose one of the two solutions. θ4, θ5, θ6 "
        "are q4, "
         "q5, q6.", "Letters: nx … az, c1, s1, c23, s23, s5, w."),
        _IRB120_TABLE, _ZERO,
    ),
    "Table III.3": Exercise(
        "The flange of the ABB IRB 120 is at x = −44.11, y = 383.46, z = 786.00 mm, with roll, pitch and yaw of 77.71, "
        "−0.38 and 170.88° (turns about the fixed x, y, z, in this order). Find the eight solutions q1 to q6 in "
        "degrees, "
        "in any order. Joint limits do not count.",
        "The arm can turn by half a turn, the elbow can be up or down, the wrist can flip: two choices each.",
        (
            "The wrist's centre lies 72 mm behind the flange: p − 72 a.",
            "q1 is its azimuth, 100.0°, or half a turn from it, −80.0°.",
            "For each, the law of cosines gives two q3, −64.90° and −89.00°, and each gives one q2.",
            "For each of these four, q5 is the angle between axis 4 and the hand with both signs, and q4 and q6 "
            "follow; a "
            "change of sign turns both by half a turn.",
        ),
        (_DISTAL, "Two decimals are enough."), _IRB120_TABLE, _ZERO,
    ),
    "Equations IV.5 to IV.9, IV.25, IV.26": Exercise(
        "A frame moves by a small displacement dx, dy, dz and small turns rx, ry, rz. To first order its pose becomes "
        "T + ΔT T. Write ΔT, 4 by 4, in these six letters.",
        "A small turn is the identity plus the matrix of a cross product with its angles.",
        (
            "Rot(r) ≈ I + [r×], with [r×] = [0, −rz, ry; rz, 0, −rx; −ry, rx, 0].",
            "Trans(d) Rot(r) − I has [r×] as its rotation's part and d as its last column. The last row is zero.",
        ),
        ("Letters: dx, dy, dz, rx, ry, rz.",),
    ),
    "Equation IV.12": Exercise(
        "The matrix of a link is A = [cos θ, −sin θ cos α, sin θ sin α, a cos θ; sin θ, cos θ cos α, −cos θ sin α, a "
        "sin θ; "
        "0, sin α, cos α, d; 0, 0, 0, 1]. Write its derivative by θ, 4 by 4.",
        "Differentiate each entry: a cosine becomes minus a sine, and what holds no θ becomes 0.",
        (
            "The first row becomes minus the sine row: −sin θ, −cos θ cos α, cos θ sin α, −a sin θ.",
            "The second row becomes the old first row. The third and the last row hold no θ.",
        ),
        ("Letters: θ, α, a, d.",),
    ),
    "Equations IV.13 to IV.18": Exercise(
        "The matrix of a link is A = Rot(z, θ) Trans(z, d) Trans(x, a) Rot(x, α). Its derivative by each parameter is "
        "A times "
        "a matrix Q: ∂A/∂θ = A Qθ, and so on. Find Qθ, Qd, Qa and Qα, each 4 by 4.",
        "Q is A⁻¹ ∂A/∂θ. What stands left of the factor with the parameter drops out of it.",
        (
            "Qα: α is the last factor, so Qα is the generator of a turn about x: −1 at (2,3) and 1 at (3,2).",
            "Qa: a length along x, which Rot(x, α) leaves alone: 1 at (1,4).",
            "Qd: a length along the old z, seen from the new frame: Rot(x, −α) (0, 0, 1) = (0, sin α, cos α).",
            "Qθ: a turn about the old z, whose axis is (0, sin α, cos α) and passes −a along x: its upper left is the "
            "cross "
            "product's matrix, and its last column (0, sin α, cos α) × (a, 0, 0) = (0, a cos α, −a sin α).",
        ),
        ("Letters: α, a.",),
    ),
    "Equations IV.7, IV.19 to IV.24": Exercise(
        "A serial arm is the product of its link matrices A1 … An. An error of a parameter of link i moves the last "
        "frame "
        "by a product of the matrices from one link on. With which link does that product begin? A text says: from "
        "link 1. "
        "Answer in the same form.",
        "The error of a link moves only what is beyond it.",
        (
            "∂(A1 … An)/∂(parameter of Ai) = A1 … Ai Qi Ai+1 … An.",
            "Seen from the last frame: (Ai+1 … An)⁻¹ Qi (Ai+1 … An). Links before i do not appear.",
        ),
    ),
    "Table IV.1": Exercise(
        "An arm of six hinges (the ABB IRB 120, distal convention) has 24 parameters: errors δθ, δr (of d), δl (of a) "
        "and δα "
        "of six links. Only the place of the flange's origin is measured, and base and tool are known. How many of "
        "the 24 "
        "can be identified? Which are left out? With how many poses at least can all the others be found?",
        "Parallel neighbours share a length along their axes. What only turns the last frame about its origin does "
        "not move "
        "that. Behind joint 5 two lengths do what two angles do, too. Each pose gives three numbers.",
        (
            "The axes 2 and 3 are parallel: δr2 and δr3 add up. One of them goes: δr2.",
            "The measured origin lies on axis 6: δθ6 and δα6 turn the frame about it, and do nothing.",
            "From link 5 the point is 72 mm along z5, across the axis of joint 5. δθ5 moves it as δl5 does, and δα5 "
            "as δr5 "
            "does: δl5 and δr5 go.",
            "24 − 5 are left. Poses: three numbers each, so more than 6 are needed for 19 numbers.",
        ),
        ("Of two parameters that do the same leave out the length; of two lengths the first.",
         "Write a list as in: dr1, dl1, dtheta1, dalpha1."),
        _IRB120_TABLE, _ZERO,
    ),
    "Conclusion": Exercise(
        "A thesis chooses 20 poses by each of five observability indices, simulates one campaign with noise for each, "
        "and "
        "compares the errors of the parameters. The errors of O1 to O5 differ by less than another draw of the noise "
        "changes them. Which index does this comparison show to be the best? Answer with an index, or: none by one "
        "draw.",
        "Compare the differences with the scatter of one index over many draws.",
        (
            "Over 1,000 draws the RMS of each index scatters more than the indices differ.",
            "So the order of one draw is a matter of chance. Means over many draws, or the covariance itself, can "
            "decide.",
        ),
    ),
}  # fmt: skip

ELASTIC_EXERCISES = {
    "Equations 3.22 to 3.29": Exercise(
        "Write five elementary motions as matrices, 4 by 4: a shift by L along x; a small elastic displacement by dx, "
        "dy, "
        "dz; and turns by r about x, y and z.",
        "A shift is the identity with a last column. A turn about an axis leaves this axis alone.",
        (
            "Trans(x, L) has L in the first row of the last column. The elastic displacement has dx, dy, dz there.",
            "Rot(z, r) has (cos r, sin r, 0) and (−sin r, cos r, 0) as its first columns.",
            "Rot(x, r) has the same in rows and columns 2 and 3; Rot(y, r) in 3 and 1, so that −sin r stands at (3,1).",
        ),
        ("Letters: L, dx, dy, dz, r.",),
    ),
}

STAUBLI_EXERCISES = {
    "Equation 1.2": Exercise(
        "In Khalil's convention a link is described by α, d, θ and r. Write the matrix T of the frame of a link in "
        "the frame "
        "of the link before, without its last row: 3 by 4.",
        "Multiply the four matrices from left to right.",
        (
            "Rot(x, α) Trans(x, d): the place is (d, 0, 0), the rotation that by α.",
            "Rot(z, θ) then makes the first two columns: (cos θ, cos α sin θ, sin α sin θ) and (−sin θ, cos α cos θ, "
            "sin α cos θ).",
            "Trans(z, r) moves by r along the third column, (0, −sin α, cos α).",
        ),
        ("T is the product Rot(x, α) · Trans(x, d) · Rot(z, θ) · Trans(z, r).", "Letters: α, d, θ, r, or alpha, "
        "theta."),
    ),
    "Equations 1.3, 1.5": Exercise(
        "The base of a robot stands somewhere in a measuring room. How many parameters locate its frame in the room's?",
        "It has a place and a rotation.",
        ("A place has three coordinates.", "A rotation has three freedoms: together six."),
    ),
    "Equations 1.4, 1.6": Exercise(
        "Frame 1 is reached from the room by Rot(z, γz) Trans(z, bz) Rot(x, αz) Trans(x, dz) Rot(z, θz) Trans(z, rz) "
        "Rot(z, θ1) Trans(z, r1), where joint 1 turns by θ1. How many of the eight parameters γz, bz, αz, dz, θz, rz, "
        "θ1 "
        "(its zero), r1 are independent? And how many parameters, at most, has the step from one joint's axis to the "
        "next?",
        "Turns about the same axis add up, and so do lengths along it, where one follows the other.",
        (
            "Rot(z, θz) Trans(z, rz) Rot(z, θ1) Trans(z, r1) = Rot(z, θz + θ1) Trans(z, rz + r1).",
            "Two pairs become two sums: 8 − 2.",
            "Between axes: α and d about and along x, θ and r about and along z. A line in space has no more.",
        ),
    ),
    "Table 1": Exercise(
        "Find the parameters of the Stäubli RX 130 in Khalil's convention, for frames as given: of each link α, d, θ "
        "− q (the "
        "constant part of θ) and r.",
        "α and d lead from one axis to the next one about and along x, θ and r about and along z. Where two axes "
        "meet, d is "
        "0.",
        (
            "Axis 1 is the base's z: all zero. Axis 2 meets it: z2 = y1 is α = −90°, and x2 points up at q2 = 0: "
            "θ − q = −90°.",
            "Axis 3 is parallel, d = 625 mm along x2. x3 points forward: θ − q = +90°.",
            "Axis 4 meets axis 3: z4 = −y3 is α = 90°. The wrist's centre is r = 625 mm along it.",
            "z5 = y4 is −90°, z6 = −y5 is 90°; the flange is r = 110 mm along z6.",
        ),
        ("A link's matrix is Rot(x, α) · Trans(x, d) · Rot(z, θ) · Trans(z, r): z of frame i lies along the axis of "
        "joint i.",
         "With all joints at zero: axis 1 is vertical. Axis 2 meets it at a right angle; z2 points along y1. The "
         "upper arm, "
         "625 mm to axis 3, points up along x2. Axis 3 is parallel to axis 2, and x3 points as x1 does. Axis 4 meets "
         "axis "
         "3, z4 against y3. The wrist's centre, where axes 4, 5 and 6 meet, is 625 mm along axis 4. z5 points along "
         "y4, z6 "
         "against y5. The flange is 110 mm beyond the wrist's centre, along z6. The base's frame lies at axis 2's "
         "height."),
        sketch=partial(arm_sketch, "rx130", (0, 0, 0, 0, 0, 0)),
    ),
    "Section 1.3.5": Exercise(
        "The Stäubli RX 130 has six hinges; only the axes 2 and 3 are parallel. A parameter β, a turn about y, is "
        "added where "
        "the usual four fail. Of which joint is it? And how many parameters can be identified with it and without it, "
        "if a "
        "tracker measures one point fixed to the hand, off the last axis, and neither base nor point is known?",
        "Four parameters lead to each axis of a hinge, also to the first one from the tracker, and the point adds "
        "three.",
        (
            "β stands in the step between the parallel axes, from 2 to 3: it belongs to joint 3.",
            "Six axes have four parameters each: 24. The point has three coordinates in the last frame.",
            "In the step between parallel axes r2 and r3 do the same, so one of them falls out there, and β3 takes its "
            "place: 24 + 3 = 27.",
            "Without β3 there is one less.",
        ),
        ("Write a joint as its number.",),
    ),
    "Figure 3": Exercise(
        "Two axes are a distance d apart and almost parallel: the second is tilted by β, in the plane of both. The "
        "parameter r "
        "says how far along the first axis their common normal lies. Write r by d and β. How far away is it, in m, "
        "for the "
        "625 mm of a Stäubli RX 130 and 1 mrad?",
        "Axes in one plane meet somewhere: their common normal is at that point.",
        (
            "The axes and the distance d make a right triangle with the angle β at the point where they meet.",
            "So |r| = d / tan β. The second axis leans away from the first on the upper side, so they meet below: r < "
            "0.",
            "625 mm / 0.001 is 625,000 mm.",
        ),
        ("β is positive where the second axis leans away from the first on the side of positive r.",
         "Letters: d, β or beta. The distance of the second answer has no sign."),
    ),
}  # fmt: skip
