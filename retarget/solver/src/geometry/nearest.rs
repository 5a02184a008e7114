use super::Solid;
use crate::math::*;
#[derive(Clone, Copy, Debug)]
pub struct Nearest {
    pub distance: f64,
    pub a: Vec3,
    pub b: Vec3,
    pub normal: Vec3,
}
#[derive(Default)]
pub struct Scratch;
pub fn gap_at_least(a: &Solid, b: &Solid) -> f64 {
    norm(sub(a.position, b.position)) - a.shape.reach() - b.shape.reach()
}
pub fn nearest(a: &Solid, b: &Solid, _s: &mut Scratch) -> Nearest {
    let d = sub(a.position, b.position);
    let n = unit_or(d, [0.0, 0.0, 1.0]);
    let dist = norm(d) - a.shape.reach() - b.shape.reach();
    Nearest {
        distance: dist,
        a: sub(a.position, scale(n, a.shape.reach())),
        b: add(b.position, scale(n, b.shape.reach())),
        normal: n,
    }
}
