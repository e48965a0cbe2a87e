"""Texts of the exercises of Mallem 2011: question, what is given, hint, and the way to the solution."""

from collections.abc import Callable
from functools import partial

from lab.extensions.reproduction.item import Exercise
from lab.extensions.reproduction.models import arm_sketch
from lab.render.document import Picture

__all__ = ["COURSE_EXERCISES"]


def _sketch(name: str, *degrees_or_mm: float) -> "Callable[[], tuple[Picture, ...]]":
    return partial(arm_sketch, name, degrees_or_mm)


_SHORTHAND = "Shorthand: c1 and s1 are cos q1 and sin q1, c12 is cos(q1 + q2)."
_CRAIG = (
    "A link's matrix is Rot(x, α) · Trans(x, a) · Rot(z, θ) · Trans(z, r). Frame 0 is the base's; z of frame i lies "
    "along "
    "the axis of joint i.",
)
_ARM = (
    "The arm VERSATRAN FA has six joints: q1 turns about the vertical, q2 slides up along it, q3 slides out "
    "horizontally, "
    "and q4, q5, q6 turn the wrist.",
)
_VERSATRAN = _sketch("versatran", 20, 700, 800, 30, 40, 50)
_VERSATRAN_TABLE = (
    ("joint", "α (°)", "a", "θ", "r"), ("1", "0", "0", "q1", "0"), ("2", "0", "0", "0", "q2"),
    ("3", "−90", "0", "0", "q3"), ("4", "0", "0", "q4", "0"), ("5", "−90", "0", "q5", "0"), ("6", "90", "0", "q6", "0"),
)  # fmt: skip
_HAND = (
    "px, py, pz is the wrist's centre, where the axes 4, 5 and 6 meet. x, y and z are the columns of the hand's "
    "rotation, "
    "with the components xx, xy, xz; yx, yy, yz; zx, zy, zz.",
    "The hand's point px7, py7, pz7 lies r7 beyond the wrist's centre, along z.",
)

COURSE_EXERCISES = {
    "Section 5.6": Exercise(
        "An arm has fewer joints than its hand has freedoms, so its Jacobian J has more rows than columns, and its "
        "columns "
        "are independent. The pseudo-inverse J⁺ gives the joint steps dq = J⁺ dX that come closest to a displacement "
        "dX. "
        "Write J⁺ as a product of J and its transpose.",
        "Multiply J dq = dX by the transpose from the left, and solve for dq.",
        (
            "J dq = dX has more equations than unknowns. We look for the dq with the least |J dq − dX|.",
            "Multiply by Jᵗ from the left: JᵗJ dq = Jᵗ dX. These are the normal equations.",
            "JᵗJ is square, and has an inverse since the columns of J are independent.",
            "For a redundant arm, with more joints than freedoms, JᵗJ is singular. There J⁺ = Jᵗ(JJᵗ)⁻¹.",
        ),
        ("Write the transpose as J' and an inverse as ^-1.",),
    ),
    "Section 6.1": Exercise(
        "What volume can the tip of each of these five carriers reach, in units of L³? Hinges turn by 360°, slides "
        "move "
        "from 0 to L. A link that a hinge turns is L long; all other links have no length. Give two decimals, or a "
        "product with pi.",
        "Find the area that the last two joints cover in their plane. A first hinge sweeps this area along a circle: "
        "the "
        "volume is the area times the way of its centre (Pappus).",
        (
            "Cylindrical: a disk of radius L (area π L²), moved up by L.",
            "Anthropomorphic: two links of L fill the ball of radius 2 L: (4/3) π (2 L)³.",
            "Cartesian: a cube with sides L.",
            "Spherical: a slide of L that points everywhere fills the ball of radius L: (4/3) π L³.",
            "Toric: two links of L fill a disk of radius 2 L, of area 4 π L², moved up by L.",
        ),
        table=(
            ("carrier", "joint 1", "joint 2", "joint 3"),
            ("RPP, cylindrical", "hinge, vertical", "slide, up", "slide, outwards"),
            (
                "RRR, anthropomorphic",
                "hinge, vertical",
                "hinge, horizontal, L from the tip's hinge",
                "hinge, parallel to joint 2, L from the tip",
            ),
            ("PPP, Cartesian", "slide along x", "slide along y", "slide along z"),
            ("RRP, spherical", "hinge, vertical", "hinge, horizontal", "slide, outwards"),
            ("RRP, toric", "hinge, vertical", "hinge, vertical, L beside joint 1", "slide, up, L beside joint 2"),
        ),
    ),
    "Section 6.2": Exercise(
        "An arm is redundant where it has more joints than its hand has independent motions. Are these two arms "
        "redundant? "
        "Answer with one of: redundant (in every configuration), locally redundant (in some), not redundant.",
        "Compare the number of joints with the rank of the Jacobian, at a general position and at a special one.",
        (
            "The Panda has seven joints, and a hand has at most six freedoms: seven is more than six everywhere.",
            "The SCEMI has six joints, and rank 6 at a general position. With q5 = 0 the axes 4 and 6 are on one "
            "line, and "
            "the rank is 5: there six joints make five motions.",
        ),
        (
            "The Franka Panda: seven hinges in series.",
            "The SCEMI: six hinges in series, of which the last three meet in the wrist's centre; q5 bends the wrist.",
        ),
    ),
    "Section 7.1": Exercise(
        "A point is given by its polar coordinates: azimuth θ1, elevation θ2 above the horizontal plane, distance R "
        "from "
        "the origin. Another one by its cylindrical coordinates: azimuth θ1, distance L from the z axis, height z. "
        "Write "
        "x, y and z of both. Azimuths count from the x axis.",
        "Project the distance on the horizontal plane first. Cylindrical coordinates have that projection at once.",
        (
            "Polar: the distance's projection on the horizontal plane is R cos θ2, and its height R sin θ2.",
            "The azimuth divides the projection into x and y by its cosine and sine.",
            "Cylindrical: L is the projection already.",
        ),
        ("Letters: θ1, θ2, R, L, z (angles may be written theta1, theta2).",),
    ),
    "Section 7.2": Exercise(
        "A PRP arm has a vertical slide, a vertical hinge and a horizontal slide. Find x, y, z of its tip (direct "
        "model), "
        "T1, θ1 and T2 of a tip x, y, z (inverse model), the Jacobian J of x, y, z by T1, θ1, T2, and its inverse.",
        "Differentiate x, y and z by T1, θ1 and T2 in turn. The inverse follows from a turn by −θ1 about z.",
        (
            "Seen from above, the boom is L2 + T2 long and points along θ1. The first slide alone lifts: z = T1.",
            "Inverse: T1 = z; the quadrant of θ1 needs both y and x; y = (L2 + T2) s1 gives T2.",
            "J has a column for each joint: (0, 0, 1); (−(L2 + T2) s1, (L2 + T2) c1, 0); (c1, s1, 0).",
            "dx and dy turned by −θ1 are dT2 and (L2 + T2) dθ1: c1 dx + s1 dy, and −s1 dx + c1 dy.",
        ),
        (
            "T1 lifts the boom, θ1 turns it from the x axis, and the boom is L2 + T2 long.",
            "Letters: T1, θ1, T2, L2; of the inverse model x, y, z too. c1 and s1 are cos θ1 and sin θ1.",
        ),
        sketch=_sketch("carrier/prp", 300, 100, 200),
    ),
    "Section 7.3": Exercise(
        "An RRR arm stands on a column of height l1. θ1 turns it about the vertical, and an upper arm l2 and a "
        "forearm l3 "
        "move in the vertical plane of θ1. Find x, y and z of its tip, θ1, cos θ3 and θ2 of a tip, and the "
        "determinant of "
        "the Jacobian of x, y, z.",
        "θ1 follows from x and y alone. Then (L, z − l1) is the sum of two links in a plane: square and add.",
        (
            "Out and up, the upper arm is l2 (s2, −c2) and the forearm l3 (−s23, c23).",
            "So L = l2 s2 − l3 s23 and z − l1 = −l2 c2 + l3 c23. x and y are L c1 and L s1.",
            "Square and add: L² + (z − l1)² = l2² + l3² − 2 l2 l3 c3. This gives cos θ3.",
            "With θ3 known, both equations are linear in s2 and c2: L = (l2 − l3 c3) s2 − l3 s3 c2, and "
            "z − l1 = −(l2 − l3 c3) c2 − l3 s3 s2.",
            "The Jacobian's determinant is L times the determinant of the plane arm: L · l2 l3 s3.",
        ),
        (
            "θ2 counts from straight down: at θ2 = 0 the upper arm points down, at θ2 = 90° outwards.",
            "At θ3 = 0 the forearm lies folded back along the upper arm; θ3 turns it on in the sense of θ2.",
            "L is the distance of the tip from axis 1, with a sign: negative where the arm reaches over its back. w "
            "is that "
            "sign, 1 or −1; you may also choose one of the two solutions.",
            "Letters: θ1, θ2, θ3, l1, l2, l3; of the inverse model x, y, z, L, w. c23 is cos(θ2 + θ3).",
        ),
        sketch=_sketch("carrier/rrr", 100, 120, 60),
    ),
    "Section 7.4": Exercise(
        "Inverse models lead to ten types of equations, here with general coefficients X, Y, Z, W. The unknowns are "
        "the "
        "angles θ, θi, θj and the length r. How many solutions has each type, angles counted once a turn?",
        "Where sine and cosine of the angle both follow, there is one root. Where a square root is left, both of its "
        "signs "
        "hold.",
        (
            "Type 1 is linear. Type 3 gives sine and cosine: one angle.",
            "Types 2, 9 and 10 give the angle by a root, with two signs.",
            "Type 4: r and −r hold, the angle half a turn apart. Type 5: sin² + cos² = 1 is a quadratic equation in r.",
            "Types 6 and 7: square and add, and θj is gone: an equation of type 2 is left. Its two roots give θj each.",
            "Type 8 is the plane arm of two links: elbow up and down.",
        ),
        table=(
            ("type", "equations"),
            ("1", "X r = Y"),
            ("2", "X sin θ + Y cos θ = Z"),
            ("3", "X1 sin θ = Y1; X2 cos θ = Y2"),
            ("4", "X1 r sin θ = Y1; X2 r cos θ = Y2 (two unknowns)"),
            ("5", "X1 sin θ = Y1 + Z1 r; X2 cos θ = Y2 + Z2 r (two unknowns)"),
            ("6", "W sin θj = X cos θi + Y sin θi + Z1; W cos θj = X sin θi − Y cos θi + Z2"),
            ("7", "W1 cos θj + W2 sin θj = X cos θi + Y sin θi + Z1; W1 sin θj − W2 cos θj = X sin θi − Y cos θi + Z2"),
            ("8", "X cos θi + Y cos(θi + θj) = Z1; X sin θi + Y sin(θi + θj) = Z2"),
            ("9", "X cos θ = Y"),
            ("10", "X sin θ = Y"),
        ),
    ),
    "Section 8.1": Exercise(
        "In Craig's convention (the modified one) a link is described by α, a, θ and r. Write the matrix T, 4 by 4, "
        "of the "
        "frame of a link in the frame of the link before.",
        "Multiply the four matrices from left to right. The last row is 0, 0, 0, 1.",
        (
            "Rot(x, α) Trans(x, a): the place is (a, 0, 0), the rotation that by α.",
            "Rot(z, θ) then makes the first two columns: (cos θ, cos α sin θ, sin α sin θ) and (−sin θ, cos α cos θ, "
            "sin α cos θ). The third stays (0, −sin α, cos α).",
            "Trans(z, r) moves by r along the third column.",
        ),
        (
            "T is the product Rot(x, α) · Trans(x, a) · Rot(z, θ) · Trans(z, r), with turns about x and z.",
            "Letters: α, a, θ, r, or alpha and theta.",
        ),
    ),
    "Section 8.2, table": Exercise(
        "Find α and a of the six joints of the VERSATRAN FA in Craig's convention, for its frames as given.",
        "α is the angle from one joint's axis to the next one's, about x, and a is their distance: 0 where they meet.",
        (
            "Axes 1 and 2 are on one line: α2 = 0, a2 = 0. Axis 1 is the base's z: α1 = 0, a1 = 0.",
            "z3 = y2: a turn about x by −90° brings z to y. The axes 2 and 3 meet: a3 = 0.",
            "Axis 4 is on the line of axis 3. z5 = y4 is −90° again, and z6 = −y5 is +90°.",
            "The axes 4, 5 and 6 meet in the wrist's centre, so all a are 0.",
        ),
        (
            *_ARM,
            *_CRAIG,
            "Axis 1 is z of frame 0. Axis 2 lies on axis 1. Axis 3 is horizontal and meets axis 2. Axis 4 lies on axis "
            "3. Axes 4, 5 and 6 meet in a point, the wrist's centre.",
            "With all angles at zero the x axes of all frames are parallel; z3 points along y2, z4 along z3, z5 along "
            "y4, and "
            "z6 against y5.",
        ),
        sketch=_VERSATRAN,
    ),
    "Section 8.2, matrices": Exercise(
        "Write the six link matrices T0,1 to T5,6 of the VERSATRAN FA from its table.",
        "Put each row of the table into the matrix of section 8.1. Of a slide θ is constant, and r is its joint's "
        "position.",
        (
            "T = [cos θ, −sin θ, 0, a; cos α sin θ, cos α cos θ, −sin α, −r sin α; sin α sin θ, sin α cos θ, cos α, "
            "r cos α; 0, 0, 0, 1].",
            "Row 1, α = 0: a turn about z by q1. Row 2: a shift by q2 along z.",
            "Row 3, α = −90°: cos α = 0 and sin α = −1, so that r = q3 stands in the second row.",
            "Rows 4 to 6: turns by q4, q5, q6 with α = 0, −90° and 90°.",
        ),
        (*_CRAIG, _SHORTHAND),
        _VERSATRAN_TABLE,
        _VERSATRAN,
        table_of="Section 8.2, table",
    ),
    "Section 8.4": Exercise(
        "Multiply the link matrices of the VERSATRAN FA, and a tool of length r7 along z of the last frame, to T0,7: "
        "the "
        "pose of the hand. Write the rotation in the joints. In the last column you may use zx, zy, zz, the entries of "
        "your third column.",
        "Begin at the hand: three turns make the wrist. Then T0,3 turns it by q1 and moves it.",
        (
            "The wrist T3,6 has the columns (c4 c5 c6 − s4 s6, s4 c5 c6 + c4 s6, −s5 c6), "
            "(−c4 c5 s6 − s4 c6, −s4 c5 s6 + c4 c6, s5 s6), (c4 s5, s4 s5, c5).",
            "T0,3 has the rotation [c1, 0, −s1; s1, 0, c1; 0, −1, 0] and the place (−s1 q3, c1 q3, q2).",
            "Multiply row by column. The place is that of the wrist's centre, plus r7 times the third column.",
        ),
        (*_CRAIG, _SHORTHAND),
        _VERSATRAN_TABLE,
        _VERSATRAN,
        table_of="Section 8.2, table",
    ),
    "Section 8.5, J": Exercise(
        "Write the Jacobian J of the VERSATRAN FA, 6 by 6: above the velocity of the wrist's centre, below the hand's "
        "angular velocity, both in the base's frame, by the rates of the six joints.",
        "The column of a slide is its z above zeros. That of a hinge is z × (p − its origin) above z.",
        (
            "Joint 1: z = (0, 0, 1), and z × p = (−py, px, 0).",
            "Joint 2 slides along (0, 0, 1), joint 3 along z3 = (−s1, c1, 0).",
            "The axes 4, 5 and 6 pass through the wrist's centre: their upper halves are zero.",
            "Their directions are z4 = z3, z5 = (−c1 s4, −s1 s4, −c4), and z6 = (zx, zy, zz).",
        ),
        (*_HAND[:1], "Letters: q1 to q6 with c1, s4 …, px, py, pz, zx, zy, zz."),
        _VERSATRAN_TABLE,
        _VERSATRAN,
        table_of="Section 8.2, table",
    ),
    "Section 8.5, rates": Exercise(
        "From the Jacobian of the VERSATRAN FA write the velocity dpx, dpy, dpz of the wrist's centre and the angular "
        "velocity dφx, dφy, dφz in the joints and their rates dq1 to dq6. Then write the rates dxx … dzz of the hand's "
        "axes x and z by dφ, and the velocity of a point of the hand that lies a7 along x and r7 along z.",
        "The first six are J dq. An axis of the hand turns with it: its rate is dφ × the axis.",
        (
            "dp = J's upper half times dq: joint 1 moves the centre by dq1 (−py, px, 0), and px = −s1 q3, py = c1 q3.",
            "dφ = dq1 z0 + dq4 z4 + dq5 z5 + dq6 z6.",
            "dx = dφ × x and dz = dφ × z, component by component.",
            "The point is p + a7 x + r7 z. Its rate is dp + a7 dx + r7 dz.",
        ),
        (
            *_HAND[:1],
            "Letters: q1 to q6, dq1 to dq6, dφx …, xx … zz, dxx … dzz, a7, r7. φ may be written phi.",
        ),
        sketch=_VERSATRAN,
        earlier=(
            (
                "Section 8.5, J",
                "J has the columns (−py, px, 0; 0, 0, 1), (0, 0, 1; 0, 0, 0), (−s1, c1, 0; 0, 0, 0), "
                "(0, 0, 0; −s1, c1, 0), (0, 0, 0; −c1 s4, −s1 s4, −c4), (0, 0, 0; z).",
            ),
            ("Section 8.4", "z = (c1 c4 s5 − s1 c5, s1 c4 s5 + c1 c5, −s4 s5), and p = (−s1 q3, c1 q3, q2)."),
        ),
    ),
    "Section 8.6": Exercise(
        "The pose of the hand of the VERSATRAN FA is given: its point px7, py7, pz7 and the columns x, y, z of its "
        "rotation. Find q2, q3, q1, then q5, q4 and q6. What you have found may be used further on, as c1 and s1 in "
        "q5.",
        "Go back from the hand to the wrist by r7 z. The wrist's place gives q2, q3 and q1. z in the turned frame "
        "gives q5 "
        "and q4, and x and y give q6.",
        (
            "The wrist's centre is p = p7 − r7 z, and the direct model says p = (−s1 q3, c1 q3, q2).",
            "So q2 is pz; q3 is the distance from the axis; and −px and py are s1 q3 and c1 q3.",
            "z turned back by q1: c1 zx + s1 zy = c4 s5, −s1 zx + c1 zy = c5, zz = −s4 s5.",
            "c5 gives q5 up to its sign w. Divided by sin q5, the two others give q4 by atan2.",
            "In the same frame the second component of x is −s5 c6, and that of y is s5 s6: they give q6.",
        ),
        (
            *_HAND,
            "q3 is positive on the real arm. q5 has two solutions; w is the sign of sin q5, 1 or −1, and you may also "
            "choose "
            "one of them.",
            "Letters: px7, py7, pz7, xx … zz, r7, w, and joints already found.",
        ),
        sketch=_VERSATRAN,
        earlier=(
            (
                "Section 8.4",
                "The direct model: p = (−s1 q3, c1 q3, q2), and z = (c1 c4 s5 − s1 c5, s1 c4 s5 + c1 c5, −s4 s5), "
                "−s1 xx + c1 xy = −s5 c6, −s1 yx + c1 yy = s5 s6.",
            ),
        ),
    ),
    "Section 8.7": Exercise(
        "A displacement dpx, dpy, dpz of the wrist's centre and a turn dφx, dφy, dφz of the hand are wanted. Find the "
        "joint steps dq2, dq3, dq1, then dq5, dq6 and dq4 of the VERSATRAN FA. You may use dq1 in dq5 and dq6, and "
        "dq6 in "
        "dq4.",
        "dp gives dq2, dq3 and dq1. What is left of dφ after dq1 is the wrist's: turn it by −q1 first.",
        (
            "dp = (−c1 q3 dq1 − s1 dq3, −s1 q3 dq1 + c1 dq3, dq2): turned by −q1 it is (−q3 dq1, dq3, dq2).",
            "The wrist's part of dφ, turned by −q1: e = c1 dφx + s1 dφy, f = −s1 dφx + c1 dφy, g = dφz − dq1.",
            "It is e = −s4 dq5 + c4 s5 dq6, f = dq4 + c5 dq6, g = −c4 dq5 − s4 s5 dq6.",
            "−s4 e − c4 g = dq5, and c4 e − s4 g = s5 dq6. Then f gives dq4.",
        ),
        ("Letters: q1 to q6, dpx, dpy, dpz, dφx, dφy, dφz, and steps already found. φ may be written phi.",),
        sketch=_VERSATRAN,
        earlier=(
            (
                "Section 8.5, rates",
                "The differential model: dpx = −c1 q3 dq1 − s1 dq3, dpy = −s1 q3 dq1 + c1 dq3, dpz = dq2; "
                "dφx = −s1 dq4 − c1 s4 dq5 + (c1 c4 s5 − s1 c5) dq6, "
                "dφy = c1 dq4 − s1 s4 dq5 + (s1 c4 s5 + c1 c5) dq6, dφz = dq1 − c4 dq5 − s4 s5 dq6.",
            ),
        ),
    ),
    "Section 8.2, figure": Exercise(
        "Find the determinant of the 6 by 6 Jacobian of the VERSATRAN FA at its wrist's centre, and its value in a "
        "drawn "
        "posture with q5 = 0.",
        "A block of J is zero, so det J is the product of two determinants of three rows each.",
        (
            "J has a block of zeros at the upper right: the wrist does not move its own centre.",
            "The upper left block has the columns (−c1 q3, −s1 q3, 0), (0, 0, 1), (−s1, c1, 0). Its determinant, the "
            "first "
            "times the cross product of the others, is q3 (c1² + s1²).",
            "The lower right block has the determinant z4 · (z5 × z6). This is minus the sine of q5.",
            "With q5 = 0 the product is 0: the axes 4 and 6 are on one line.",
        ),
        ("Letters: q1 to q6, with c1, s4 …",),
        sketch=_VERSATRAN,
        earlier=(
            (
                "Section 8.5, J",
                "J has the columns (−c1 q3, −s1 q3, 0; 0, 0, 1), (0, 0, 1; 0, 0, 0), (−s1, c1, 0; 0, 0, 0), "
                "(0, 0, 0; −s1, c1, 0), (0, 0, 0; −c1 s4, −s1 s4, −c4), "
                "(0, 0, 0; c1 c4 s5 − s1 c5, s1 c4 s5 + c1 c5, −s4 s5).",
            ),
        ),
    ),
    "Section 8.3": Exercise(
        "Complete the table of the SCEMI, an arm of six hinges, in Craig's convention, and write its six link matrices "
        "T0,1 to T5,6. σ is 0 for a hinge and 1 for a slide; r is the constant part.",
        "Put z along each joint's axis and x along the common normal. Where two axes meet, a is 0.",
        (
            "All six joints are hinges: σ = 0 everywhere.",
            "A turn about x by α brings z to (0, −sin α, cos α): −y is α = 90°, +y is α = −90°, and parallel is 0.",
            "a3 = 500 mm lies between the parallel axes 2 and 3, r4 = 500 mm along axis 4, r6 = 100 mm along axis 6.",
            "Each matrix is [cos θ, −sin θ, 0, a; cos α sin θ, cos α cos θ, −sin α, −r sin α; sin α sin θ, sin α cos "
            "θ, "
            "cos α, r cos α] with its row.",
        ),
        (
            *_CRAIG,
            "Axis 1 is vertical, through the base's origin. Axis 2 is horizontal and meets it. Axis 3 is parallel to "
            "axis 2, "
            "500 mm along x2. Axis 4 meets axis 3 at a right angle. The wrist's centre lies 500 mm along z4, where "
            "the axes 4, "
            "5 and 6 meet. The last frame's origin is 100 mm beyond it, along z6.",
            "z2 and z5 point against y of the frame before, z4 and z6 along it; z3 is parallel to z2.",
            "Tables in ° and mm; lengths in the matrices in m, as a3, r4 and r6 or as 0.5 and 0.1. " + _SHORTHAND,
        ),
        sketch=_sketch("scemi", 100, 40, 30, 30, 40, 0),
    ),
    "Section 8.8": Exercise(
        "Find the determinant of the 6 by 6 Jacobian of the SCEMI at its wrist's centre (so with r6 = 0), and name its "
        "three kinds of singular positions by the part of the arm that causes them: a list like ankle, knee, hip, but "
        "of "
        "the arm.",
        "The Jacobian has a block of zeros: its determinant is the arm's times the wrist's.",
        (
            "The wrist does not move its own centre: the upper right block of J is zero.",
            "The wrist's block has the determinant s5 up to its sign: it is zero when the axes 4 and 6 are on one "
            "line.",
            "The arm's block is a RRR arm with two links of 0.5 m: the product of both links, the sine of the angle "
            "between "
            "them, here c3, and the distance of the wrist's centre from axis 1, here 0.5 c2 − 0.5 s23.",
            "So it is zero with a straight elbow (c3 = 0), with the wrist's centre above the shoulder (0.5 s23 = 0.5 "
            "c2), "
            "and with a straight wrist (s5 = 0).",
        ),
        (
            "Table in Craig's convention, lengths in m; a link's matrix is Rot(x, α) Trans(x, a) Rot(z, θ) Trans(z, "
            "r).",
            "Letters: q2, q3, q5 and numbers, or a3 and r4 for 0.5 m. " + _SHORTHAND,
        ),
        (
            ("joint", "α (°)", "a", "θ", "r"),
            ("1", "0", "0", "q1", "0"),
            ("2", "90", "0", "q2", "0"),
            ("3", "0", "0.5", "q3", "0"),
            ("4", "−90", "0", "q4", "0.5"),
            ("5", "90", "0", "q5", "0"),
            ("6", "−90", "0", "q6", "0"),
        ),
        _sketch("scemi", 100, 40, 30, 30, 40, 0),
        table_of="Section 8.3",
    ),
    "Section 8.9": Exercise(
        "A SCARA has two vertical hinges q1 and q2, a vertical slide q3 and a vertical hinge q4. Find: the type of its "
        "first three joints, as three letters R (hinge) or P (slide); its table in Craig's convention; its link "
        "matrices; "
        "x, y, z of its tip; q2 and q1 of a tip; the 4 by 4 Jacobian of x, y, z and the angle about z by q1 to q4; "
        "and its "
        "determinant.",
        "Seen from above it is an arm of two links: the law of cosines gives q2.",
        (
            "All axes are parallel: all α are 0. The lengths 400 and 250 mm stand between the axes 1 and 2, and 2 and "
            "3.",
            "x and y are two links in the plane, with the angles q1 and q1 + q2. z is the slide alone.",
            "x² + y² = 0.4² + 0.25² + 2 · 0.4 · 0.25 c2 gives q2 with two signs: elbow on either side.",
            "x = (0.4 + 0.25 c2) c1 − 0.25 s2 s1 and y = (0.4 + 0.25 c2) s1 + 0.25 s2 c1 are linear in c1 and s1.",
            "Joint 1 moves the tip by (−y, x), joint 2 by the second link's (−0.25 s12, 0.25 c12).",
            "The determinant is −y · 0.25 c12 + x · 0.25 s12. It is zero with a straight or folded elbow.",
        ),
        (
            *_CRAIG,
            "Axis 2 is 400 mm from axis 1, axes 3 and 4 are on one line, 250 mm from axis 2. All z point up, and the "
            "four origins are at one height for q3 = 0. σ is 0 for a hinge and 1 for a slide; r is the constant part.",
            "Table in ° and mm; all else in m. Letters: q1 to q4, x, y, z, and a2 and a3 or 0.4 and 0.25. "
            + _SHORTHAND,
            "w is the sign of sin q2, 1 or −1: you may use it, or choose one of the two solutions.",
        ),
        sketch=_sketch("scara", 20, 60, -100, 0),
    ),
    "Section 10.3, question 1": Exercise(
        "A robot has two hinges: q1 turns about the vertical axis z through the origin, and q2 lifts an arm of length "
        "L2 "
        "above the horizontal, from a shoulder at the height L1 on the axis. Find x, y, z of its tip, q1 and q2 of a "
        "tip, "
        "and the 3 by 2 Jacobian of x, y, z.",
        "z depends on q2 alone. Seen from above, the arm is L2 cos q2 long.",
        (
            "The arm's projection on the horizontal plane is L2 c2; q1 turns it from the x axis.",
            "q1 is the azimuth of (x, y). q2 is the angle of the height z − L1 over the distance from the axis.",
            "Differentiate x, y and z by q1, then by q2.",
        ),
        ("Letters: q1, q2, L1, L2; of the inverse model x, y, z. " + _SHORTHAND,),
        sketch=_sketch("course2r", 100, 40),
    ),
    "Section 10.3, question 2": Exercise(
        "A robot of two hinges has its tip at x = L2 cos q2 cos q1, y = L2 cos q2 sin q1, z = L1 + L2 sin q2, with "
        "L1 = 0.5 m and L2 = 1 m. It goes from rest at P0 through P1, with the tip's velocity given there, to rest at "
        "P2. "
        "Each joint has four phases of constant acceleration: two from P0 to P1, two from P1 to P2. All phases are as "
        "long "
        "for both joints, and as short as 50 °/s² allows. Find the joints, the phases, the accelerations, and the "
        "largest "
        "speed of a joint.",
        "The slower joint decides. q1 goes 90° from rest to rest: speed up for half the time, slow down for the other "
        "half. "
        "q2 has the same phases.",
        (
            "q1 = atan2(y, x) and q2 = asin((z − L1)/L2) give the joints at P0, P1, P2.",
            "At P1 the tip's velocity (0, 0, 0.2) m/s is L2 cos q2 dq2: dq2 = 0.2 rad/s = 11.459 °/s, and dq1 = 0.",
            "q1 goes 90° in two phases of T at ±50 °/s²: 50 T² = 90, T = 1.34164 s. Four phases take 5.36656 s.",
            "q2 goes 30° to the speed 11.459 °/s in the same two phases: with accelerations a and b, "
            "(a + b) T = 11.459 and a T²/2 + (a T) T + b T²/2 = 30. So a = 12.396 and b = −3.855 °/s².",
            "The second half is the mirror of the first. The largest speed is q1's after phase 1: 50 T = 67.08 °/s.",
        ),
        ("The largest speed allowed, 171.9 °/s, is not reached.",),
        (
            ("point", "x (m)", "y (m)", "z (m)", "velocity of the tip"),
            ("P0", "√3/2", "0", "0", "0"),
            ("P1", "0", "1", "0.5", "(0, 0, 0.2) m/s"),
            ("P2", "√3/2", "0", "1", "0"),
        ),
        _sketch("course2r", 0, -30),
    ),
    "Section 10.3, approximation": Exercise(
        "The robot of two hinges of question 2 (L1 = 0.5 m, L2 = 1 m, 50 °/s², from (√3/2, 0, 0) by P1 = (0, 1, 0.5) "
        "to "
        "(√3/2, 0, 1) m) may pass P1 at a distance: the tip's x may be 0.1 m there instead of 0, at the same height. "
        "At "
        "which q1 does it turn back if it goes as little as it must, and how long does the whole motion take?",
        "The tip stays on the circle of radius 1 m at this height. Fewer degrees at the same acceleration take less "
        "time.",
        (
            "At z = 0.5 m the arm is horizontal, so x² + y² = 1 and y = √0.99. q1 = atan2(√0.99, 0.1) = 84.261°.",
            "Two phases of T at ±50 °/s² go 50 T² = 84.261: T = 1.29816 s.",
            "Four such phases take 5.1926 s, instead of 5.3666 s.",
        ),
        sketch=_sketch("course2r", 84.26, 0),
    ),
    "Section 11.3.1": Exercise(
        "In a 2-RPR two legs of lengths ρ1 and ρ2 lead from fixed hinges at (0, 0) and (L, 0) to one common hinge at "
        "(x, y). Find ρ1² and ρ2² of x, y; X and Y of ρ1, ρ2; the matrices A and B of A dX + B dρ = 0 from the "
        "squares; "
        "the determinant of J in dX = J dρ; and where it is zero (a serial singularity).",
        "ρ1 and ρ2 are distances from two fixed points: take one square from the other. Differentiate the squares for "
        "A "
        "and B.",
        (
            "Pythagoras gives ρ1² = x² + y² and ρ2² = (x − L)² + y².",
            "Their difference is linear in x: ρ1² − ρ2² = 2 L x − L². Then y follows from ρ1², with two signs.",
            "Differentiate x² + y² − ρ1² = 0 and (x − L)² + y² − ρ2² = 0: rows (2 x, 2 y) and (2 (x − L), 2 y), and "
            "−2 ρ1, "
            "−2 ρ2 on the diagonal of B.",
            "J = −A⁻¹B: det J = det B / det A = 4 ρ1 ρ2 / (4 L y). It is zero if one of the legs has no length.",
        ),
        (
            "Letters: x, y, L of the inverse model; ρ1, ρ2, L of the direct one; ρ1, ρ2, L, y of det J. ρ may be "
            "written "
            "rho.",
            "Write the singularity as in: ρ1 = 1 or ρ2 = 1.",
        ),
    ),
    "Sections 11.3, 11.3.2": Exercise(
        "A 3-RPR has three legs of lengths ρ1, ρ2, ρ3 between hinges of the base, A1, A2, A3, and hinges of a "
        "platform, "
        "B1, B2, B3. Write the squares of the legs' lengths for a platform with B1 at (x, y) and turned by φ. Then "
        "count "
        "the mobility of three plane robots with three legs each: with the joints R-P-R, P-R-R and R-R-R in each leg.",
        "Place each hinge of the platform by x, y and φ, and take its distance from the base's. In the plane each "
        "body has 3 "
        "freedoms, and each hinge or slide takes 2.",
        (
            "B1 = (x, y), B2 = B1 + l2 (cos φ, sin φ), B3 = B1 + l3 (cos(φ + θ), sin(φ + θ)).",
            "ρi² is the square of Bi − Ai.",
            "Bodies that move: two a leg, and the platform: 7. Joints: 9. Mobility: 3 · 7 − 2 · 9 = 3, for each of "
            "them.",
        ),
        (
            "A1 = (0, 0), A2 = (c2, 0), A3 = (c3, d3). B2 lies l2 from B1 in the direction φ, B3 l3 from B1 in the "
            "direction "
            "φ + θ.",
            "Letters: x, y, φ, θ, c2, c3, d3, l2, l3. φ and θ may be written phi and theta.",
        ),
    ),
    "Sections 11.4.4, 11.6": Exercise(
        "A Delta has three legs: a motor's hinge on the base turns an arm, and two parallel rods with a ball joint at "
        "either end lead from the arm to the platform. Count its moving bodies, joints, freedoms of all joints, "
        "internal "
        "freedoms (rods that turn about themselves), and its mobility; and the mobility with a fourth motor that turns "
        "the tool in the platform. Then find the motors' angles θ1, θ2, θ3 for two places of the platform, arms "
        "outwards.",
        "The mobility is the sum of the joints' freedoms, less 6 for each independent loop, less the internal ones. "
        "For the "
        "angles: the elbow is one arm's length from its motor and one rod's length from the platform's corner.",
        (
            "Bodies: 3 arms, 6 rods, 1 platform. Joints: 3 hinges and 12 balls. Freedoms: 3 · 1 + 12 · 3 = 39.",
            "Loops: joints less bodies, 15 − 10 = 5. Mobility: 39 − 6 · 5 − 6 = 3. The fourth motor adds 1.",
            "In leg i's frame the platform's corner lies at (u, v, z): u is the platform's place along ei, plus "
            "43.879 mm, less 163.679 mm; v is its place across ei.",
            "The elbow is (524 cos θ, 0, −524 sin θ). Its distance from the corner is 1244 mm: "
            "u cos θ − z sin θ = (u² + v² + z² + 524² − 1244²)/(2 · 524), of type 2. The solution with the arm "
            "outwards "
            "counts.",
        ),
        (
            "Motors lie 163.679 mm from the middle of the base, in the directions e1, e2, e3 at −90°, 30° and 150° "
            "from x; "
            "the platform's corners 43.879 mm from its middle, in the same directions.",
            "Arms are 524 mm long, rods 1244 mm; the two rods of a leg count as one in their middle.",
            "z points up, the platform hangs below, and the platform does not turn. θ is 0 with the arm horizontal, "
            "outwards, "
            "and positive downwards.",
        ),
    ),
    "Section 11.5": Exercise(
        "A bar A1 E of length L moves in the plane. Its end E is at (X, Y), and θ is the bar's angle from the x axis. "
        "Legs "
        "1 and 3 hold the end A1, leg 2 holds the end E. The legs are anchored at (a1, b1), (a2, b2) and (a3, b3). "
        "Write "
        "the squares q1², q2², q3² of their lengths, the largest number of poses with the same lengths, and the pose "
        "T0,E, "
        "4 by 4, of the frame at E whose x axis lies along the bar.",
        "A1 is E less L along the bar. Legs 1 and 3 place A1 by two circles; leg 2 then turns the bar.",
        (
            "A1 = (X − L cos θ, Y − L sin θ). q1 and q3 are its distances from the anchors 1 and 3, q2 that of E from "
            "anchor 2.",
            "Two circles about the anchors 1 and 3 meet in two points A1. About each, the circle of E with the radius "
            "L "
            "meets leg 2's circle in two points.",
            "T0,E is a turn by θ about z, and the place (X, Y, 0).",
        ),
        ("Letters: X, Y, θ, L, a1 … b3; θ may be written theta.",),
    ),
    "Annex, A3.1": Exercise(
        "The axes of a turned frame have nine direction cosines. How many of them are independent?",
        "Each axis has length 1, and each two of them are at right angles: count these conditions.",
        ("Three lengths and three right angles are six conditions.", "9 − 6 = 3: a rotation has three freedoms."),
    ),
    "Annex, A3.2": Exercise(
        "Write the rotation R, 3 by 3, by roll θx, pitch θy and yaw θz: a turn by θx about x, then by θy about the "
        "fixed y, "
        "then by θz about the fixed z.",
        "Turns about fixed axes are multiplied from the left: R is the product of the turns about z, y and x, in this "
        "order.",
        (
            "Rot(y, θy) Rot(x, θx) = [cos θy, sin θx sin θy, cos θx sin θy; 0, cos θx, −sin θx; −sin θy, sin θx cos "
            "θy, "
            "cos θx cos θy].",
            "Rot(z, θz) mixes the first two rows: cos θz times the first less sin θz times the second, and so on.",
        ),
        ("Letters: θx, θy, θz, or thetax, thetay, thetaz. sθx is sin θx.",),
    ),
    "Annex, A3.3 to A3.6, figure A3.1": Exercise(
        "A unit axis u comes from z by two turns: first by β about the fixed x axis, then by α about the fixed z "
        "axis. Write "
        "its components ux, uy, uz. Then write the matrix R, 3 by 3, of a turn by θ about u, with C = cos θ and S = "
        "sin θ.",
        "Tilt z by β, then turn it by α about z. The matrix is C times the identity, plus S times the matrix of u ×, "
        "plus "
        "(1 − C) u uᵗ.",
        (
            "Rot(x, β) brings z to (0, −sin β, cos β). Rot(z, α) turns this to u.",
            "u uᵗ has the entries ux uy …; the matrix of u × is [0, −uz, uy; uz, 0, −ux; −uy, ux, 0].",
            "Add C I + S [u×] + (1 − C) u uᵗ (Rodrigues).",
        ),
        ("Letters: α, β of the axis; ux, uy, uz, C, S of the matrix.",),
    ),
    "Annex, A3.7 to A3.11": Exercise(
        "A rotation has the columns i, j and k, with the components ix, iy, iz; jx, jy, jz; kx, ky, kz. It is a turn "
        "by θ "
        "(0 ≤ θ ≤ π) about the unit axis u. Find C = cos θ, the products 2 ux S, 2 uy S, 2 uz S with S = sin θ, then S "
        "itself, tan θ by S and C, and ux, uy, uz by C and the entries, each with its sign.",
        "The trace is 1 + 2 C. What is below the diagonal less what is above it is 2 S times a component of u.",
        (
            "R = C I + S [u×] + (1 − C) u uᵗ. Its trace is 3 C + (1 − C) = 1 + 2 C.",
            "The symmetric parts fall out of R − Rᵗ = 2 S [u×]: jz − ky = 2 ux S, and so on in turn.",
            "u has the length 1: (2 S)² is the sum of the three squares, and S is not negative.",
            "On the diagonal ix = C + (1 − C) ux²: this gives |ux|, and jz − ky has its sign.",
        ),
        ("Letters: ix … kz, C, S. abs(…) is the size of a number; a sign is t/abs(t).",),
    ),
}
