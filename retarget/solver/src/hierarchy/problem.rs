//! The data of one hierarchy and its active set.

/// A limit counts as crossed beyond this (relative to its size).
pub const CROSSED: f64 = 1e-11;

/// Which side of a limit holds a variable or a row.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Side {
    #[default]
    Free,
    Lower,
    Upper,
    /// Equal limits: held on both sides, never released.
    Both,
}

/// A limit that is held, or not: that of a variable or of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Release {
    Variable(usize),
    Row(usize),
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub factorizations: u32,
    /// The whole problem was solved level by level.
    pub fallback: bool,
    /// The answer was found in what the first equalities leave.
    pub reduced: bool,
    /// The iteration cap of the fallback was met: feasible, but not proved optimal.
    pub capped: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Variables, and the padded row length (a multiple of 8).
    pub n: usize,
    pub stride: usize,
    /// Rows, `stride` apart; padding is zero.
    pub rows: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Rows of level k: `level_end[k-1]..level_end[k]`.
    pub level_end: Vec<usize>,
    /// A row that is not present takes no part.
    pub present: Vec<bool>,
    /// The box.
    pub lo: Vec<f64>,
    pub hi: Vec<f64>,
    /// Damping of each level (in units of its pivots); 0 is exact.
    pub damping: Vec<f64>,
    /// Of each level: limits whose row is left this short by the levels above ask for half; 0: for all.
    pub short_lever: Vec<f64>,
    /// How far a damped step that does not fit the box is shortened: 0 not at all, 1 until it fits.
    pub patience: Vec<f64>,
    /// Standing still (which is not z = 0 where a posture attracts): from here damped steps are shortened.
    pub still: Vec<f64>,
    /// Sides of the box that damping counts as walls: ends of ranges, not limits of speed.
    pub lo_is_stop: Vec<bool>,
    pub hi_is_stop: Vec<bool>,
    /// Warm start in, final active set out.
    pub variable_side: Vec<Side>,
    pub row_side: Vec<Side>,
    /// The answer.
    pub z: Vec<f64>,
}

impl Problem {
    /// A problem of `n` variables and `level_rows[k]` rows in level k; every entry is zero, every row absent.
    pub fn new(n: usize, level_rows: &[usize]) -> Self {
        let level_end = level_rows
            .iter()
            .scan(0, |end, rows| {
                *end += rows;
                Some(*end)
            })
            .collect();
        let mut problem = Self { level_end, ..Self::default() };
        problem.reshape(n);
        problem
    }

    /// `n` variables without limits, and as many rows as the levels end with, all absent and zero. Sizes up to those that it
    /// had once allocate nothing.
    pub fn reshape(&mut self, n: usize) {
        let m = self.level_end.last().copied().unwrap_or(0);
        self.n = n;
        self.stride = n.div_ceil(8).max(1) * 8;
        let stride = self.stride;
        refill(&mut self.rows, m * stride, 0.0);
        refill(&mut self.lower, m, 0.0);
        refill(&mut self.upper, m, 0.0);
        refill(&mut self.lo, n, f64::NEG_INFINITY);
        refill(&mut self.hi, n, f64::INFINITY);
        refill(&mut self.still, stride, 0.0);
        refill(&mut self.z, stride, 0.0);
        refill(&mut self.damping, self.level_end.len(), 0.0);
        refill(&mut self.short_lever, self.level_end.len(), 0.0);
        refill(&mut self.patience, self.level_end.len(), 0.0);
        refill(&mut self.present, m, false);
        refill(&mut self.variable_side, n, Side::Free);
        refill(&mut self.row_side, m, Side::Free);
        refill(&mut self.lo_is_stop, n, false);
        refill(&mut self.hi_is_stop, n, false);
    }

    #[inline(always)]
    pub fn row(&self, r: usize) -> &[f64] {
        &self.rows[r * self.stride..(r + 1) * self.stride]
    }

    #[inline(always)]
    pub fn row_mut(&mut self, r: usize) -> &mut [f64] {
        &mut self.rows[r * self.stride..(r + 1) * self.stride]
    }

    pub fn row_count(&self) -> usize {
        self.lower.len()
    }

    pub fn level_count(&self) -> usize {
        self.level_end.len()
    }

    #[inline(always)]
    pub fn level(&self, k: usize) -> std::ops::Range<usize> {
        let start = if k == 0 { 0 } else { self.level_end[k - 1] };
        start..self.level_end[k]
    }

    /// The limit of row `r` that `value` is beyond.
    #[inline(always)]
    pub fn crossed(&self, r: usize, value: f64) -> Option<Side> {
        if value < self.lower[r] - CROSSED {
            Some(Side::Lower)
        } else if value > self.upper[r] + CROSSED {
            Some(Side::Upper)
        } else {
            None
        }
    }

    /// Value that a held variable takes.
    #[inline(always)]
    pub fn bound(&self, i: usize) -> f64 {
        match self.variable_side[i] {
            Side::Upper => self.hi[i],
            _ => self.lo[i],
        }
    }

    /// Value that a held row asks for.
    #[inline(always)]
    pub fn target(&self, r: usize) -> f64 {
        match self.row_side[r] {
            Side::Upper => self.upper[r],
            _ => self.lower[r],
        }
    }

    #[inline(always)]
    pub fn is_equality(&self, r: usize) -> bool {
        self.lower[r] == self.upper[r]
    }

    /// Set the sides that follow from the limits themselves, and drop warm-start sides that no longer make sense.
    pub fn settle_sides(&mut self) {
        for i in 0..self.n {
            self.variable_side[i] = settled(self.variable_side[i], self.lo[i], self.hi[i]);
        }
        for r in 0..self.row_count() {
            let side = settled(self.row_side[r], self.lower[r], self.upper[r]);
            self.row_side[r] = if self.present[r] { side } else { Side::Free };
        }
    }
}

fn refill<T: Clone>(buffer: &mut Vec<T>, size: usize, value: T) {
    buffer.clear();
    buffer.resize(size, value);
}

fn settled(side: Side, lower: f64, upper: f64) -> Side {
    match side {
        _ if lower == upper => Side::Both,
        Side::Lower if lower.is_finite() => Side::Lower,
        Side::Upper if upper.is_finite() => Side::Upper,
        _ => Side::Free,
    }
}
