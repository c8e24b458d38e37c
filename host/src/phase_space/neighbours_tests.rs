//! Neighbours against brute force.

use super::*;
use crate::phase_space::embedding::Component;
use crate::phase_space::observable::Observable;

fn brute(e: &Embedding<'_>, d: usize, theiler: u32) -> Neighbours {
    let mut out = Neighbours { start: vec![NOBODY; e.len()], distance2: vec![f32::INFINITY; e.len()] };
    for (i, a) in e.starts.iter().enumerate() {
        for b in e.starts.iter().filter(|b| b.abs_diff(*a) > theiler) {
            let d2 = e.distance2(*a, *b, d);
            if d2 < out.distance2[i] {
                (out.start[i], out.distance2[i]) = (*b, d2);
            }
        }
    }
    out
}

/// An angle that whirls irregularly and crosses ±π often, and a number.
fn series(n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut x = 0.37f64;
    let (mut angle, mut angles, mut numbers) = (0.0, Vec::new(), Vec::new());
    for i in 0..n {
        x = 3.97 * x * (1.0 - x);
        angle += 0.4 * x + 0.2 * (i as f64 * 0.01).sin();
        angles.push(angle);
        numbers.push((i as f64 * 0.031).sin() + 0.1 * x);
    }
    (angles, numbers)
}

#[test]
fn finds_what_brute_force_finds() {
    let (angles, numbers) = series(1500);
    let a = Observable::angle(&[&angles[..700], &angles[700..]], 0.0, 0);
    let b = Observable::number(&[&numbers[..700], &numbers[700..]], 0.0, 0);
    let c = |of, delay| Component { of, delay };
    let e = Embedding::new(vec![c(&a, 0), c(&b, 0), c(&a, 7), c(&b, 7), c(&a, 14), c(&a, 21)], 0, usize::MAX);
    let mut hints = Vec::new();
    for d in 1..=6 {
        for theiler in [0, 40] {
            let want = brute(&e, d, theiler);
            let found = Tree::new(&e, d).nearest(theiler, &[]);
            for i in 0..e.len() {
                assert!(
                    (found.distance2[i] - want.distance2[i]).abs() <= 1e-6 * want.distance2[i],
                    "{d} {theiler} {i}"
                );
                assert!(found.start[i].abs_diff(e.starts[i]) > theiler);
            }
            let (mut best, mut stack) = (Vec::new(), Vec::new());
            for i in (0..e.len()).step_by(97) {
                Tree::new(&e, d).near(e.starts[i], theiler, 5, &mut best, &mut stack);
                let mut all: Vec<f32> = (e.starts.iter())
                    .filter(|b| b.abs_diff(e.starts[i]) > theiler)
                    .map(|b| e.distance2(e.starts[i], *b, d))
                    .collect();
                all.sort_by(f32::total_cmp);
                assert!(best.iter().zip(&all).all(|(a, b)| (a.0 - b).abs() <= 1e-6 * b) && best.len() == 5);
            }
            if theiler == 40 {
                let hinted = Tree::new(&e, d).nearest(theiler, &hints);
                assert_eq!(hinted.distance2, found.distance2, "{d}");
                hints = vec![found.start];
            }
        }
    }
}

#[test]
fn few_vectors_equal_ones_and_none_are_no_trouble() {
    let same = vec![1.0; 100];
    let o = Observable::angle(&[&same], 0.0, 0);
    let found = Tree::new(&Embedding::of_one(&o, 1, 3, 0, 1000), 3).nearest(5, &[]);
    assert!(found.distance2.iter().all(|d| *d == 0.0));
    let nobody = Tree::new(&Embedding::of_one(&o, 1, 3, 0, 1000), 3).nearest(1000, &[]);
    assert!(nobody.start.iter().all(|s| *s == NOBODY));
    for n in [0, 1, 2, 17, 33] {
        let x: Vec<f64> = (0..n).map(f64::from).collect();
        let o = Observable::number(&[&x], 0.0, 0);
        let e = Embedding::of_one(&o, 1, 1, 0, 1000);
        assert_eq!(Tree::new(&e, 1).nearest(0, &[]).distance2.len(), n as usize);
        assert_eq!(Tree::new(&e, 0).nearest(0, &[]).start.len(), n as usize);
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (angles, _) = series(9000);
    let o = Observable::angle(&[&angles], 0.0, 0);
    let e = Embedding::of_one(&o, 9, 4, 0, usize::MAX);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Tree::new(&e, 4).nearest(50, &[]))
    };
    assert_eq!(run(1), run(3));
}
