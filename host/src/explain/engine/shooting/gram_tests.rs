//! Tests of [`super`].

use super::*;

/// Rows of the first, all columns, and the target: the head's, then strips of two columns.
fn add(to: &mut Sums, rows: &DMatrix<f64>) {
    let (own, last) = (to.first + to.layout.own, rows.nrows() - 1);
    let head = DMatrix::from_fn(own + 1, rows.ncols(), |i, j| rows[(if i < own { i } else { last }, j)]);
    to.push_head(&head);
    for strip in to.layout.clone().strips(2) {
        let some = rows.rows(to.first + strip.start, strip.len()).into_owned();
        to.push(&head.as_view(), strip.start, &some.as_view());
    }
}

/// Rows whose first columns are other ones' combinations, with all columns and the target: the
/// sums are those of the rows themselves.
#[test]
fn first_columns_are_carried_to_others() {
    let mut seed = 5_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let rows = DMatrix::from_fn(8, 30, |_, _| random());
    let map = DMatrix::from_fn(2, 8, |_, _| random());
    let layout = Layout::new(2, &[1, 2]);
    let (mut sums, mut direct, mut carried) =
        (Sums::zeros(&layout, 2), Sums::zeros(&layout, 2), Sums::zeros(&layout, 2));
    add(&mut sums, &rows);
    let mut other = rows.clone();
    for (mut to, from) in other.column_iter_mut().zip(rows.column_iter()) {
        let first = from.rows(0, 2).into_owned();
        (0..8).for_each(|i| to[i] = map.column(i).dot(&first) + if i < 2 { 0.0 } else { from[i] });
    }
    add(&mut direct, &other);
    sums.carried(&map, &mut carried);
    // Products of the others with the first stand in the first rows alone.
    for (i, j) in (0..5).flat_map(|i| (0..6).map(move |j| (i, j))).filter(|(i, j)| *i < 2 || *j >= 2) {
        assert!((carried.head[(i, j)] - direct.head[(i, j)]).abs() < 1e-12, "{i} {j}");
    }
    for (a, b) in carried.groups.iter().zip(&direct.groups) {
        assert!((a - b).amax() < 1e-12);
    }
}

/// Two first columns, two own, candidates of one and two: the parts are those of the full
/// matrix with the first eliminated.
#[test]
fn parts_are_those_of_the_full_matrix() {
    let mut seed = 3_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let rows = DMatrix::from_fn(8, 40, |_, _| random());
    let layout = Layout::new(2, &[1, 2]);
    let mut sums = Sums::zeros(&layout, 2);
    add(&mut sums, &rows.columns(0, 25).into_owned());
    add(&mut sums, &rows.columns(25, 15).into_owned());
    let mut gram = sums.reduced(0).unwrap();
    let full = &rows * rows.transpose();
    let (a, b) = (full.view((0, 0), (2, 2)).into_owned(), full.view((0, 2), (2, 6)).into_owned());
    let wanted = full.view((2, 2), (6, 6)) - b.transpose() * a.try_inverse().unwrap() * &b;
    let first = gram.chosen(&[0, 1, 2]);
    let second = gram.chosen(&[0, 1, 3, 4]);
    for (i, x) in [0, 1, 2, 5].into_iter().enumerate() {
        for (j, y) in [0, 1, 2, 5].into_iter().enumerate() {
            assert!((first[(i, j)] - wanted[(x, y)]).abs() < 1e-12);
        }
    }
    for (i, x) in [0, 1, 3, 4, 5].into_iter().enumerate() {
        for (j, y) in [0, 1, 3, 4, 5].into_iter().enumerate() {
            assert!((second[(i, j)] - wanted[(x, y)]).abs() < 1e-12);
        }
    }
    assert!(gram.chosen(&[2, 3])[(0, 1)].is_nan());
    // Two parts of the rows, the first columns those of all.
    let (mut one, mut rest) = (Sums::zeros(&layout, 2), Sums::zeros(&layout, 2));
    add(&mut one, &rows.columns(0, 25).into_owned());
    add(&mut rest, &rows.columns(25, 15).into_owned());
    let solved = sums.solved(0).unwrap();
    let mut both = one.left_by(&solved).unwrap();
    let left = {
        let taken = solved.transpose() * rows.rows(0, 2);
        rows.rows(2, 6) - taken
    };
    let direct = left.columns(0, 25) * left.columns(0, 25).transpose();
    assert!((both.chosen(&[0, 1, 3, 4])[(2, 4)] - direct[(3, 5)]).abs() < 1e-12);
    both.add(&rest.left_by(&solved).unwrap());
    assert!((both.chosen(&[0, 1, 3, 4]) - &second).amax() < 1e-12);
    // The target and twice the second own column.
    let mut moved = gram.clone();
    moved.retarget(1, 2.0);
    let change = |i: usize| wanted[(i, 5)] + 2.0 * wanted[(i, 1)];
    let found = moved.chosen(&[0, 1, 4]);
    for (i, x) in [0, 1, 4].into_iter().enumerate() {
        assert!((found[(i, 3)] - change(x)).abs() < 1e-12);
    }
    assert!((found[(3, 3)] - change(5) - 2.0 * change(1)).abs() < 1e-12);
    let both = gram.joined(&gram, &layout.joined(&layout));
    for (columns, same) in [([0, 1, 6, 7], [0, 1, 3, 4]), ([0, 1, 3, 4], [0, 1, 3, 4]), ([0, 1, 5, 5], [0, 1, 2, 2])] {
        assert_eq!(both.chosen(&columns), gram.chosen(&same));
    }
    assert!(both.chosen(&[4, 6])[(0, 1)].is_nan());
    let other = gram.clone();
    gram.add(&other);
    assert!((gram.square(3) - 2.0 * wanted[(3, 3)]).abs() < 1e-12);
}
