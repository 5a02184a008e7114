//! Where a segment is nearest to a convex solid: the zero of a slope that never falls, between places where its formula changes.

use super::half_space::PARALLEL;

/// Places on a segment, in order; its ends are the first and the last.
pub struct Knots {
    t: [f64; 8],
    count: usize,
    length: f64,
}

/// The zero of the slope.
pub enum Zero {
    At(f64),
    /// Between two places, with the slopes there: below zero, above zero.
    Between([f64; 2], [f64; 2]),
}

impl Knots {
    /// Of the segment from -length to length; room for six more.
    pub fn new(length: f64) -> Self {
        Self { t: [-length; 8], count: 1, length }
    }

    /// Ignored where it is not strictly inside (or no number).
    pub fn insert(&mut self, t: f64) {
        if !(t.abs() < self.length) {
            return;
        }
        let mut k = self.count;
        while self.t[k - 1] > t {
            self.t[k] = self.t[k - 1];
            k -= 1;
        }
        self.t[k] = t;
        self.count += 1;
    }

    /// `slope` gives, at a place, half the derivative of the squared distance and the squared distance itself. Where all of a range is
    /// nearest, the answer is its middle.
    #[inline(always)]
    pub fn zero(mut self, slope: impl Fn(f64) -> (f64, f64)) -> Zero {
        self.t[self.count] = self.length;
        self.count += 1;
        let (mut low, mut falling) = (-self.length, 0.0);
        let mut flat: Option<(f64, f64)> = None;
        for &t in &self.t[..self.count] {
            let (value, squared) = slope(t);
            // The sine of the angle between the segment and the face below it, squared, is value^2 / squared.
            if value * value <= 1e-2 * PARALLEL * PARALLEL * squared {
                flat = Some((flat.map_or(t, |range| range.0), t));
            } else if value < 0.0 {
                (low, falling) = (t, value);
            } else {
                return match flat {
                    Some((first, last)) => Zero::At(0.5 * (first + last)),
                    None if falling < 0.0 => Zero::Between([low, t], [falling, value]),
                    None => Zero::At(t),
                };
            }
        }
        Zero::At(flat.map_or(self.length, |(first, last)| 0.5 * (first + last)))
    }
}

/// The zero of a slope that rises from `falling` at `low` to `rising` at `high`: regula falsi (Illinois). Each step leaves at least
/// the share `inset` on either side, until the ends are `close`.
pub fn refined(
    [mut low, mut high]: [f64; 2],
    [mut falling, mut rising]: [f64; 2],
    (inset, close): (f64, f64),
    slope: impl Fn(f64) -> f64,
) -> f64 {
    let mut kept = 0;
    for _ in 0..60 {
        let middle = low + (high - low) * (falling / (falling - rising)).clamp(inset, 1.0 - inset);
        let value = slope(middle);
        if value == 0.0 || high - low < close {
            return middle;
        }
        if value < 0.0 {
            (low, falling) = (middle, value);
            rising *= if kept == 1 { 0.5 } else { 1.0 };
            kept = 1;
        } else {
            (high, rising) = (middle, value);
            falling *= if kept == -1 { 0.5 } else { 1.0 };
            kept = -1;
        }
    }
    0.5 * (low + high)
}
