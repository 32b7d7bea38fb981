//! The column of each vertex: long lines straight, nodes over the middle of their neighbours,
//! nothing closer than its share.
//!
//! After Brandes, Köpf, "Fast and Simple Horizontal Coordinate Assignment" (2001): vertices are
//! aligned with their median neighbours to vertical blocks, from above and from below, from the
//! left and from the right; each of the four is compacted, and the mean of the middle two is taken.
//! Blocks are compacted by longest paths over the graph of neighbouring blocks, once to the left
//! and then, as far as the neighbours let them, to the right.

use super::Ladder;

/// For each vertex the column of its line or middle, in lanes, from 0.
pub fn columns(ladder: &Ladder) -> Vec<i32> {
    let crossed = crossed_inner_lines(ladder);
    let mut candidates: Vec<Vec<i32>> = Vec::with_capacity(4);
    for from_above in [true, false] {
        for mirrored in [false, true] {
            candidates.push(candidate(ladder, &crossed, from_above, mirrored));
        }
    }
    // Candidates are compared where they lie: all are moved onto the narrowest, those made from the
    // left by their left edges.
    let span = |columns: &[i32]| {
        let left = ladder.least_left(columns);
        let right = ladder.greatest_right(columns);
        (left, right)
    };
    let spans: Vec<(i32, i32)> = candidates.iter().map(|columns| span(columns)).collect();
    let narrowest = spans
        .iter()
        .min_by_key(|(left, right)| right - left)
        .copied()
        .unwrap_or((0, 0));
    for (index, (left, right)) in spans.iter().enumerate() {
        let by = if index % 2 == 0 {
            narrowest.0 - left
        } else {
            narrowest.1 - right
        };
        for column in &mut candidates[index] {
            *column += by;
        }
    }
    let mut columns: Vec<i32> = (0..ladder.vertices.len())
        .map(|vertex| {
            let mut four = [0; 4];
            for (slot, candidate) in four.iter_mut().zip(&candidates) {
                *slot = candidate[vertex];
            }
            four.sort_unstable();
            (four[1] + four[2]).div_euclid(2)
        })
        .collect();
    let left = ladder.least_left(&columns);
    for column in &mut columns {
        *column -= left;
    }
    columns
}

/// For each vertex the places among its upper neighbours (by position) whose line crosses a line
/// between two passing vertices: such a line gives way.
fn crossed_inner_lines(ladder: &Ladder) -> Vec<Vec<usize>> {
    let mut crossed = vec![Vec::new(); ladder.vertices.len()];
    for [upper, lower] in ladder.layers.array_windows() {
        let inner_upper = |vertex: usize| {
            ladder.above[vertex]
                .first()
                .copied()
                .filter(|above| ladder.vertices[vertex].passes && ladder.vertices[*above].passes)
        };
        let mut first = 0;
        let mut from = 0;
        for (place, vertex) in lower.iter().enumerate() {
            let end = inner_upper(*vertex).map(|above| ladder.position[above]);
            let is_last = place + 1 == lower.len();
            if end.is_none() && !is_last {
                continue;
            }
            let to = end.unwrap_or(upper.len().saturating_sub(1));
            for between in &lower[first..=place] {
                for above in &ladder.above[*between] {
                    let position = ladder.position[*above];
                    let is_inner =
                        ladder.vertices[*between].passes && ladder.vertices[*above].passes;
                    if !is_inner && (position < from || position > to) {
                        crossed[*between].push(*above);
                    }
                }
            }
            first = place + 1;
            from = to;
        }
    }
    crossed
}

fn candidate(
    ladder: &Ladder,
    crossed: &[Vec<usize>],
    from_above: bool,
    mirrored: bool,
) -> Vec<i32> {
    let count = ladder.vertices.len();
    let place = |vertex: usize| {
        let position = ladder.position[vertex];
        if mirrored {
            ladder.layers[ladder.vertices[vertex].layer].len() - 1 - position
        } else {
            position
        }
    };
    // Aligned vertices are chained: `next` leads round the block, `root` names it.
    let mut root: Vec<usize> = (0..count).collect();
    let mut next: Vec<usize> = (0..count).collect();
    for step in 0..ladder.layers.len() {
        let layer = if from_above {
            step
        } else {
            ladder.layers.len() - 1 - step
        };
        let mut taken: Option<usize> = None;
        for index in 0..ladder.layers[layer].len() {
            let vertex = ladder.layers[layer][if mirrored {
                ladder.layers[layer].len() - 1 - index
            } else {
                index
            }];
            let mut neighbours = if from_above {
                ladder.above[vertex].clone()
            } else {
                ladder.below[vertex].clone()
            };
            if neighbours.is_empty() {
                continue;
            }
            neighbours.sort_by_key(|other| place(*other));
            let middle = (neighbours.len() - 1) / 2;
            for other in &neighbours[middle..=neighbours.len() / 2] {
                let gives_way = if from_above {
                    crossed[vertex].contains(other)
                } else {
                    crossed[*other].contains(&vertex)
                };
                let is_free = taken.is_none_or(|last| last < place(*other));
                if next[vertex] == vertex && !gives_way && is_free {
                    next[*other] = vertex;
                    root[vertex] = root[*other];
                    next[vertex] = root[vertex];
                    taken = Some(place(*other));
                }
            }
        }
    }
    compact(ladder, &root, mirrored)
}

/// Places whole blocks.
fn compact(ladder: &Ladder, root: &[usize], mirrored: bool) -> Vec<i32> {
    let count = ladder.vertices.len();
    let mut after: Vec<Vec<(usize, i32)>> = vec![Vec::new(); count];
    let mut waiting_for = vec![0_usize; count];
    for layer in &ladder.layers {
        for [left, right] in layer.array_windows() {
            let distance = ladder.distance(*left, *right);
            let (first, second) = if mirrored {
                (root[*right], root[*left])
            } else {
                (root[*left], root[*right])
            };
            after[first].push((second, distance));
            waiting_for[second] += 1;
        }
    }
    let mut order: Vec<usize> = (0..count)
        .filter(|vertex| root[*vertex] == *vertex && waiting_for[*vertex] == 0)
        .collect();
    let mut column = vec![0; count];
    let mut done = 0;
    while done < order.len() {
        let block = order[done];
        done += 1;
        for (other, distance) in &after[block] {
            column[*other] = column[*other].max(column[block] + distance);
            waiting_for[*other] -= 1;
            if waiting_for[*other] == 0 {
                order.push(*other);
            }
        }
    }
    for block in order.iter().rev() {
        if let Some(room) = after[*block]
            .iter()
            .map(|(other, distance)| column[*other] - distance)
            .min()
        {
            column[*block] = column[*block].max(room);
        }
    }
    (0..count)
        .map(|vertex| {
            let column = column[root[vertex]];
            if mirrored { -column } else { column }
        })
        .collect()
}
