//! The linear problem of one iteration: strict, never infeasible, the same bits every time. That answers are optimal is tested from Python.

use super::random::Random;
use crate::hierarchy::{Outcome, Problem, Stages, BUDGET};

const SEEDS: u64 = 1500;
/// Damping of a body of one metre, in a frame of two iterations.
const DAMPING: f64 = 0.5;

/// A level: rows with their lower and upper limits.
type Level = Vec<(Vec<f64>, f64, f64)>;

struct Hierarchy {
    levels: Vec<Level>,
    lo: Vec<f64>,
    hi: Vec<f64>,
}

/// Equalities, inequalities of one side and of two, rows that depend on others, limits that are met at once, tight or none.
fn random_hierarchy(seed: u64) -> Hierarchy {
    let random = &mut Random::new(seed);
    let n = 2 + random.below(18);
    let size = 0.1 + random.between(0.0, 2.0);
    let bounds: Vec<(f64, f64)> = (0..n)
        .map(|_| {
            let middle = if random.chance(0.3) { random.between(-size, size) } else { 0.0 };
            match random.below(8) {
                0 => (f64::NEG_INFINITY, f64::INFINITY),
                1 => (middle, middle),
                2 => (middle, f64::INFINITY),
                _ => (middle - random.between(0.0, size), middle + random.between(0.0, size)),
            }
        })
        .collect();
    let mut known: Vec<Vec<f64>> = vec![];
    let levels = (0..1 + random.below(5)).map(|_| random_level(random, n, &mut known)).collect();
    Hierarchy { levels, lo: bounds.iter().map(|b| b.0).collect(), hi: bounds.iter().map(|b| b.1).collect() }
}

fn random_level(random: &mut Random, n: usize, known: &mut Vec<Vec<f64>>) -> Level {
    let (rows, limits) = (random.below(9), random.chance(0.7));
    (0..rows)
        .map(|_| {
            let row: Vec<f64> = match random.below(6) {
                0 if known.len() > 1 => {
                    let (a, b) = (random.below(known.len()), random.below(known.len()));
                    let (s, t) = (random.normal(), if random.chance(0.5) { random.normal() } else { 0.0 });
                    known[a].iter().zip(&known[b]).map(|(a, b)| s * a + t * b).collect()
                }
                1 => (0..n).map(|_| if random.chance(0.3) { random.normal() } else { 0.0 }).collect(),
                _ => (0..n).map(|_| random.normal()).collect(),
            };
            known.push(row.clone());
            let value = random.normal();
            match random.below(5) {
                0 if limits => (row, value, f64::INFINITY),
                1 if limits => (row, f64::NEG_INFINITY, value),
                2 if limits => (row, value, value + random.between(0.0, 1.0)),
                _ => (row, value, value),
            }
        })
        .collect()
}

impl Hierarchy {
    /// The hierarchy of the first `count` levels.
    fn problem(&self, count: usize) -> Problem {
        let levels = &self.levels[..count];
        let mut problem = Problem::new(self.lo.len(), &levels.iter().map(Vec::len).collect::<Vec<_>>());
        for (r, (row, lower, upper)) in levels.iter().flatten().enumerate() {
            problem.row_mut(r)[..row.len()].copy_from_slice(row);
            (problem.lower[r], problem.upper[r], problem.present[r]) = (*lower, *upper, true);
        }
        problem.lo.copy_from_slice(&self.lo);
        problem.hi.copy_from_slice(&self.hi);
        problem
    }

    fn inside(&self, z: &[f64]) -> bool {
        z.iter().zip(&self.lo).zip(&self.hi).all(|((z, lo), hi)| z.is_finite() && lo <= z && z <= hi)
    }
}

/// Distance of a row beyond its upper limit; negative: beyond its lower one.
fn beyond((row, lower, upper): &(Vec<f64>, f64, f64), z: &[f64]) -> f64 {
    let value: f64 = row.iter().zip(z).map(|(c, z)| c * z).sum();
    (value - upper).max(0.0) + (value - lower).min(0.0)
}

#[test]
fn any_budget_has_an_answer_inside_the_box_that_breaks_no_limit_that_standing_still_keeps() {
    let mut cut = 0;
    for seed in 0..300 {
        let mut hierarchy = random_hierarchy(seed);
        // One level, the first or another, has limits alone, which standing still keeps, as observers have before contact.
        let of_limits = seed as usize % hierarchy.levels.len().max(1);
        for row in hierarchy.levels.iter_mut().skip(of_limits).take(1).flatten() {
            (row.1, row.2) = (-row.1.abs().min(row.2.abs()) - 0.01, f64::INFINITY);
        }
        for i in 0..hierarchy.lo.len() {
            (hierarchy.lo[i], hierarchy.hi[i]) = (hierarchy.lo[i].min(0.0), hierarchy.hi[i].max(0.0));
        }
        for budget in 0.. {
            let mut problem = hierarchy.problem(hierarchy.levels.len());
            problem.damping = DAMPING;
            let outcome = Stages::default().solve(&mut problem, budget);
            let z = &problem.z[..hierarchy.lo.len()];
            assert!(outcome.steps <= budget && hierarchy.inside(z), "seed {seed}, budget {budget}");
            if !outcome.capped {
                break;
            }
            for row in hierarchy.levels.iter().skip(of_limits).take(1).flatten() {
                let off = beyond(row, z);
                assert!(off.abs() < 1e-9, "seed {seed}, budget {budget}: a limit is missed by {off:e}");
            }
            cut += 1;
        }
    }
    assert!(cut > 1000, "{cut} solves were cut");
}

#[test]
fn a_lower_level_takes_nothing_from_a_higher_one() {
    for seed in 0..SEEDS {
        let hierarchy = random_hierarchy(seed);
        let (mut lower, mut upper) = (vec![], vec![]);
        for count in 1..=hierarchy.levels.len() {
            let mut problem = hierarchy.problem(count);
            problem.damping = DAMPING;
            let mut stages = Stages::default();
            stages.solve(&mut problem, BUDGET);
            // The values that a level reaches are its bounds from there on: those of before, which the solution keeps.
            let above = lower.len();
            assert!(stages.lower[..above] == lower && stages.upper[..above] == upper, "seed {seed}");
            for (r, (row, _, _)) in hierarchy.levels[..count].iter().flatten().enumerate() {
                let off = beyond(&(row.clone(), stages.lower[r], stages.upper[r]), &problem.z).abs();
                assert!(off <= 1e-9, "seed {seed}: with {count} levels, row {r} is {off:e} beyond what it reached");
            }
            (lower, upper) = (stages.lower, stages.upper);
        }
    }
}

/// Limits that nothing can meet, and numbers of every size.
fn ugly_problem(seed: u64) -> Problem {
    let random = &mut Random::new(seed);
    let n = 1 + random.below(12);
    let rows: Vec<usize> = (0..random.below(5)).map(|_| random.below(8)).collect();
    let mut problem = Problem::new(n, &rows);
    let number = |random: &mut Random| random.normal() * 10f64.powi(random.below(13) as i32 - 6);
    for r in 0..problem.row_count() {
        let kind = random.below(5);
        for i in 0..n {
            problem.row_mut(r)[i] = match kind {
                0 => 0.0,
                1 if r > 0 => problem.row(r - 1)[i] * (1.0 + 1e-9 * random.normal()),
                _ => number(random),
            };
        }
        let (a, b) = (number(random), number(random));
        (problem.lower[r], problem.upper[r]) = match random.below(4) {
            0 => (a.min(b), a.max(b)),
            1 => (a, f64::INFINITY),
            _ => (a, a),
        };
        problem.present[r] = random.chance(0.9);
    }
    for i in 0..n {
        let (a, b) = (number(random), number(random));
        (problem.lo[i], problem.hi[i]) = match random.below(5) {
            0 => (a, a),
            1 => (a, f64::INFINITY),
            2 => (f64::NEG_INFINITY, f64::INFINITY),
            _ => (a.min(b), a.max(b)),
        };
        problem.still[i] = number(random);
    }
    if random.chance(0.5) {
        problem.damping = random.between(0.0, 1.0);
    }
    problem
}

#[test]
fn any_problem_has_a_finite_answer_inside_the_box() {
    for seed in 0..2 * SEEDS {
        let mut problem = ugly_problem(seed);
        Stages::default().solve(&mut problem, BUDGET);
        for i in 0..problem.n {
            let (z, lo, hi) = (problem.z[i], problem.lo[i], problem.hi[i]);
            assert!(z.is_finite() && lo <= z && z <= hi, "seed {seed}: {lo} <= {z} <= {hi}");
        }
    }
}

#[test]
fn the_same_bits_every_time_in_any_work_space() {
    let used = &mut Stages::default();
    for seed in 0..SEEDS {
        let mut problems = [ugly_problem(seed), ugly_problem(seed), ugly_problem(seed)];
        let spaces = [&mut Stages::default(), &mut Stages::default(), &mut *used];
        let outcomes: Vec<Outcome> =
            problems.iter_mut().zip(spaces).map(|(p, stages)| stages.solve(p, BUDGET)).collect();
        let bits = |p: &Problem| p.z.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
        for k in 1..3 {
            assert!(bits(&problems[0]) == bits(&problems[k]) && outcomes[0] == outcomes[k], "seed {seed}, run {k}");
            assert!(problems[0].held == problems[k].held, "seed {seed}, run {k}");
        }
    }
}
