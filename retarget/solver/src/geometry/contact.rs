//! Nearest points for a known direction and distance: the middle of the faces that meet. A face is the part of a solid that is extreme
//! in one direction: a point, a segment, a rectangle or a disc.

use super::capsules::{crossing, Segment};
use super::solid::{Nearest, Scratch, Shape, Solid};
use crate::math::{across, add, add_scaled, column, dot, mat_vec, norm, scale, sub, Vec3};

/// A rectangle: two unit axes and the half sizes along them.
#[derive(Clone, Copy)]
struct Rectangle {
    centre: Vec3,
    axes: [Vec3; 2],
    half: [f64; 2],
}

impl Rectangle {
    /// Coordinates of p along the axes.
    fn local(&self, p: Vec3) -> [f64; 2] {
        let from = sub(p, self.centre);
        [dot(from, self.axes[0]), dot(from, self.axes[1])]
    }

    fn world(&self, [x, y]: [f64; 2]) -> Vec3 {
        add_scaled(add_scaled(self.centre, self.axes[0], x), self.axes[1], y)
    }

    fn nearest_to(&self, p: Vec3) -> Vec3 {
        let [x, y] = self.local(p);
        self.world([x.clamp(-self.half[0], self.half[0]), y.clamp(-self.half[1], self.half[1])])
    }
}

/// A disc; its normal is the last of the axes.
#[derive(Clone, Copy)]
struct Disc {
    centre: Vec3,
    axes: [Vec3; 3],
    radius: f64,
}

impl Disc {
    fn nearest_to(&self, p: Vec3) -> Vec3 {
        let from = sub(p, self.centre);
        let across = add_scaled(from, self.axes[2], -dot(from, self.axes[2]));
        let far = norm(across);
        add_scaled(self.centre, across, if far > self.radius { self.radius / far } else { 1.0 })
    }
}

#[derive(Clone, Copy)]
enum Face {
    Point(Vec3),
    Segment(Segment),
    Rectangle(Rectangle),
    Disc(Disc),
}

impl Face {
    /// The face of `solid` that is extreme in the unit world direction n; a side is parallel below the sine `parallel`.
    fn of(solid: &Solid, n: Vec3, parallel: f64) -> Self {
        match solid.shape {
            Shape::Capsule { half_length, radius } => {
                round_side(solid.axis(), add_scaled(solid.position, n, radius), half_length, n, parallel)
            }
            Shape::Cylinder { half_length, radius } => cylinder(solid, half_length, radius, n, parallel),
            Shape::Box { half } => brick(solid, half, n, parallel),
            Shape::HalfSpace => Self::Point(solid.position),
        }
    }

    fn nearest_to(&self, p: Vec3) -> Vec3 {
        match self {
            Self::Point(point) => *point,
            Self::Segment(segment) => {
                let along = dot(sub(p, segment.centre), segment.axis);
                segment.at(along.clamp(-segment.half_length, segment.half_length))
            }
            Self::Rectangle(rectangle) => rectangle.nearest_to(p),
            Self::Disc(disc) => disc.nearest_to(p),
        }
    }
}

/// A segment where it is across n, else its end.
fn round_side(axis: Vec3, centre: Vec3, half_length: f64, n: Vec3, parallel: f64) -> Face {
    let sine = dot(axis, n);
    if sine.abs() > parallel {
        Face::Point(add_scaled(centre, axis, half_length.copysign(sine)))
    } else {
        Face::Segment(Segment { centre, axis, half_length })
    }
}

fn cylinder(solid: &Solid, half_length: f64, radius: f64, n: Vec3, parallel: f64) -> Face {
    let axis = solid.axis();
    let sine = dot(axis, n);
    let radial = across(n, axis);
    let slope = norm(radial);
    if slope > parallel {
        return round_side(axis, add_scaled(solid.position, radial, radius / slope), half_length, n, parallel);
    }
    let centre = add_scaled(solid.position, axis, half_length.copysign(sine));
    Face::Disc(Disc { centre, axes: [column(&solid.rotation, 0), column(&solid.rotation, 1), axis], radius })
}

fn brick(solid: &Solid, half: Vec3, n: Vec3, parallel: f64) -> Face {
    let rotation = &solid.rotation;
    let (mut centre, mut free, mut count) = (solid.position, [0; 3], 0);
    for k in 0..3 {
        let axis = column(rotation, k);
        let sine = dot(axis, n);
        if sine.abs() > parallel {
            centre = add_scaled(centre, axis, half[k].copysign(sine));
        } else {
            free[count] = k;
            count += 1;
        }
    }
    let (first, second) = (free[0], free[1]);
    match count {
        0 => Face::Point(centre),
        1 => Face::Segment(Segment { centre, axis: column(rotation, first), half_length: half[first] }),
        _ => Face::Rectangle(Rectangle {
            centre,
            axes: [column(rotation, first), column(rotation, second)],
            half: [half[first], half[second]],
        }),
    }
}

/// The disc's rim as a polygon of sixteen corners.
fn rim(disc: &Disc) -> impl Iterator<Item = Vec3> + '_ {
    let (s, c) = libm::sincos(std::f64::consts::PI / 8.0);
    let mut at = [disc.radius, 0.0];
    (0..16).map(move |_| {
        let point = add_scaled(add_scaled(disc.centre, disc.axes[0], at[0]), disc.axes[1], at[1]);
        at = [c * at[0] - s * at[1], s * at[0] + c * at[1]];
        point
    })
}

/// Corners of a rectangle, in turn.
fn corners(r: &Rectangle) -> impl Iterator<Item = Vec3> + '_ {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .into_iter()
        .map(|[x, y]| add_scaled(add_scaled(r.centre, scale(r.axes[0], r.half[0]), x), scale(r.axes[1], r.half[1]), y))
}

/// The point of `face` at which it meets `other`, seen along their normal. None if it has to be computed from `other`.
fn meeting(face: &Face, other: &Face, scratch: &mut Scratch) -> Option<Vec3> {
    match (face, other) {
        (Face::Point(p), _) => Some(*p),
        (Face::Segment(s), Face::Segment(other)) => Some(s.at(crossing(s, other).s)),
        (Face::Segment(s), Face::Rectangle(r)) => Some(s.at(over_rectangle(s, r))),
        (Face::Segment(s), Face::Disc(d)) => Some(s.at(over_disc(s, d))),
        (Face::Rectangle(subject), Face::Rectangle(r)) => Some(clipped(corners(subject), subject.centre, r, scratch)),
        (Face::Disc(d), Face::Rectangle(r)) => Some(clipped(rim(d), d.centre, r, scratch)),
        (Face::Disc(d), Face::Disc(other)) => Some(between_discs(d, other)),
        _ => None,
    }
}

/// Middle of the range [low, high] cut to [-half, half]; the nearer end if nothing is left.
fn middle_of(low: f64, high: f64, half: f64) -> f64 {
    let (low, high) = (low.max(-half), high.min(half));
    (0.5 * (low + high)).clamp(-half, half)
}

fn over_rectangle(s: &Segment, r: &Rectangle) -> f64 {
    let start = r.local(s.centre);
    let (mut low, mut high) = (-s.half_length, s.half_length);
    for k in 0..2 {
        let step = dot(s.axis, r.axes[k]);
        let (first, last) = ((-r.half[k] - start[k]) / step, (r.half[k] - start[k]) / step);
        // A side that is parallel to the segment does not cut it; min and max ignore NaN.
        if step != 0.0 {
            low = low.max(first.min(last));
            high = high.min(first.max(last));
        }
    }
    middle_of(low, high, s.half_length)
}

fn over_disc(s: &Segment, d: &Disc) -> f64 {
    let from = sub(s.centre, d.centre);
    let flat = add_scaled(from, d.axes[2], -dot(from, d.axes[2]));
    let nearest = -dot(flat, s.axis);
    let half_chord = (d.radius * d.radius - dot(flat, flat) + nearest * nearest).max(0.0).sqrt();
    middle_of(nearest - half_chord, nearest + half_chord, s.half_length)
}

fn between_discs(d: &Disc, other: &Disc) -> Vec3 {
    let from = sub(other.centre, d.centre);
    let flat = add_scaled(from, d.axes[2], -dot(from, d.axes[2]));
    let apart = norm(flat);
    if apart < 1e-12 {
        return d.centre;
    }
    let along = middle_of(apart - other.radius, apart + other.radius, d.radius);
    add_scaled(d.centre, flat, along / apart)
}

/// Middle of a face over a rectangle, in the plane of the face.
fn clipped(subject: impl Iterator<Item = Vec3>, centre: Vec3, r: &Rectangle, scratch: &mut Scratch) -> Vec3 {
    scratch.polygon.clear();
    for point in subject {
        scratch.polygon.push(r.local(point));
    }
    scratch.polygon.clip(r.half, &mut scratch.clipped);
    let at = r.local(centre);
    let middle =
        scratch.polygon.middle().unwrap_or([at[0].clamp(-r.half[0], r.half[0]), at[1].clamp(-r.half[1], r.half[1])]);
    add_scaled(add_scaled(centre, r.axes[0], middle[0] - at[0]), r.axes[1], middle[1] - at[1])
}

/// Sines below which sides count as parallel, tried in turn: on nearly parallel sides an end of one may miss the other.
const PARALLEL: [f64; 4] = [1e-9, 1e-7, 1e-5, 1e-3];
/// Nearest points may miss the faces by this, m.
pub const MISS: f64 = 1e-10;

/// Nearest points on the faces that are extreme along the `normal`, and the distance (m) by which they miss the faces.
fn on_faces(
    a: &Solid,
    b: &Solid,
    (normal, distance): (Vec3, f64),
    parallel: f64,
    scratch: &mut Scratch,
) -> (Nearest, f64) {
    let (face_a, face_b) = (Face::of(a, scale(normal, -1.0), parallel), Face::of(b, normal, parallel));
    if let Some(point) = meeting(&face_a, &face_b, scratch) {
        let opposite = add_scaled(point, normal, -distance);
        let miss = norm(sub(opposite, face_b.nearest_to(opposite)));
        return (Nearest { distance, a: point, b: opposite, normal }, miss);
    }
    let point = meeting(&face_b, &face_a, scratch).unwrap_or(b.position);
    let opposite = add_scaled(point, normal, distance);
    (Nearest { distance, a: opposite, b: point, normal }, norm(sub(opposite, face_a.nearest_to(opposite))))
}

/// Nearest points for a known unit `normal` (b to a) and `distance`, and the distance (m) by which they miss the solids.
pub fn meet(a: &Solid, b: &Solid, normal: Vec3, distance: f64, scratch: &mut Scratch) -> (Nearest, f64) {
    let mut best = on_faces(a, b, (normal, distance), PARALLEL[0], scratch);
    for &parallel in &PARALLEL[1..] {
        if best.1 <= MISS {
            break;
        }
        let found = on_faces(a, b, (normal, distance), parallel, scratch);
        if found.1 < best.1 {
            best = found;
        }
    }
    best
}

/// Nearest points of a core with `radius` and a solid. `point` of the core is nearest, `out` (not zero) away from the surface, both in the
/// solid's frame.
pub fn apart(solid: &Solid, point: Vec3, out: Vec3, radius: f64) -> Nearest {
    let core_distance = norm(out);
    let normal = mat_vec(&solid.rotation, scale(out, 1.0 / core_distance));
    let b = add(solid.position, mat_vec(&solid.rotation, sub(point, out)));
    let distance = core_distance - radius;
    Nearest { distance, a: add_scaled(b, normal, distance), b, normal }
}
