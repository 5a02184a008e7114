//! The part of a solid that is extreme in one direction: a point, a segment, a rectangle or a disc.

use super::capsules::Segment;
use super::{Shape, Solid};
use crate::math::{across, add_scaled, column, dot, norm, scale, sub, Vec3};

/// A rectangle: two unit axes and the half sizes along them.
#[derive(Clone, Copy)]
pub struct Rectangle {
    pub centre: Vec3,
    pub axes: [Vec3; 2],
    pub half: [f64; 2],
}

impl Rectangle {
    /// Coordinates of p along the axes.
    pub fn local(&self, p: Vec3) -> [f64; 2] {
        let from = sub(p, self.centre);
        [dot(from, self.axes[0]), dot(from, self.axes[1])]
    }

    pub fn world(&self, [x, y]: [f64; 2]) -> Vec3 {
        add_scaled(add_scaled(self.centre, self.axes[0], x), self.axes[1], y)
    }

    fn nearest_to(&self, p: Vec3) -> Vec3 {
        let [x, y] = self.local(p);
        self.world([x.clamp(-self.half[0], self.half[0]), y.clamp(-self.half[1], self.half[1])])
    }
}

/// A disc; its normal is the last of the axes.
#[derive(Clone, Copy)]
pub struct Disc {
    pub centre: Vec3,
    pub axes: [Vec3; 3],
    pub radius: f64,
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
pub enum Face {
    Point(Vec3),
    Segment(Segment),
    Rectangle(Rectangle),
    Disc(Disc),
}

impl Face {
    /// What of `solid` is extreme in the unit world direction n; a side is parallel below the sine `parallel`.
    pub fn of(solid: &Solid, n: Vec3, parallel: f64) -> Self {
        match solid.shape {
            Shape::Capsule { half_length, radius } => {
                round_side(solid.axis(), add_scaled(solid.position, n, radius), half_length, n, parallel)
            }
            Shape::Cylinder { half_length, radius } => cylinder(solid, half_length, radius, n, parallel),
            Shape::Box { half } => brick(solid, half, n, parallel),
            Shape::HalfSpace => Self::Point(solid.position),
        }
    }

    pub fn nearest_to(&self, p: Vec3) -> Vec3 {
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
pub fn rim(disc: &Disc) -> impl Iterator<Item = Vec3> + '_ {
    let (s, c) = (std::f64::consts::PI / 8.0).sin_cos();
    let mut at = [disc.radius, 0.0];
    (0..16).map(move |_| {
        let point = add_scaled(add_scaled(disc.centre, disc.axes[0], at[0]), disc.axes[1], at[1]);
        at = [c * at[0] - s * at[1], s * at[0] + c * at[1]];
        point
    })
}

/// Corners of a rectangle, in turn.
pub fn corners(r: &Rectangle) -> impl Iterator<Item = Vec3> + '_ {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .into_iter()
        .map(|[x, y]| add_scaled(add_scaled(r.centre, scale(r.axes[0], r.half[0]), x), scale(r.axes[1], r.half[1]), y))
}
