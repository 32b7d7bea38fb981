//! The order of the vertices within their layers, so that few lines cross.
//!
//! Sweeps down and up sort each layer by the mean position of the neighbours (Sugiyama, Tagawa,
//! Toda 1981); neighbours in a layer then change places where that saves crossings (Gansner,
//! Koutsofios, North, Vo 1993). Crossings are counted as inversions in a Fenwick tree (after Barth,
//! Jünger, Mutzel 2002).

use super::Ladder;

/// Sweeps without a better order after which the search ends.
const PATIENCE: usize = 4;
/// Sweeps at most.
const SWEEPS: usize = 24;
/// Rounds of exchanging neighbours at most.
const EXCHANGES: usize = 8;

/// Orders the layers of `ladder`.
pub fn sort(ladder: &mut Ladder) {
    let mut best = ladder.layers.clone();
    let mut least = crossings(ladder);
    let mut fruitless = 0;
    for sweep in 0..SWEEPS {
        if least == 0 || fruitless == PATIENCE {
            break;
        }
        let (downwards, mirrored) = (sweep % 2 == 0, sweep % 4 >= 2);
        for step in 1..ladder.layers.len() {
            let layer = if downwards {
                step
            } else {
                ladder.layers.len() - 1 - step
            };
            sort_layer(ladder, layer, downwards, mirrored);
        }
        exchange(ladder);
        let now = crossings(ladder);
        if now < least {
            least = now;
            best.clone_from(&ladder.layers);
            fruitless = 0;
        } else {
            fruitless += 1;
        }
    }
    ladder.layers = best;
    ladder.number();
}

/// Sorts one layer by its neighbours above or below. Vertices without such keep their places.
/// `mirrored` turns those of equal rank around.
fn sort_layer(ladder: &mut Ladder, layer: usize, by_upper: bool, mirrored: bool) {
    let mut places = Vec::new();
    let mut movable = Vec::new();
    for (place, vertex) in ladder.layers[layer].iter().enumerate() {
        let neighbours = if by_upper {
            &ladder.above[*vertex]
        } else {
            &ladder.below[*vertex]
        };
        if neighbours.is_empty() {
            continue;
        }
        let sum: usize = neighbours.iter().map(|next| ladder.position[*next]).sum();
        places.push(place);
        // The mean in fixed point: positions are far below 2^40.
        movable.push(((sum << 20) / neighbours.len(), *vertex));
    }
    if mirrored {
        movable.reverse();
    }
    movable.sort_by_key(|(mean, _)| *mean);
    for (place, (_, vertex)) in places.into_iter().zip(movable) {
        ladder.layers[layer][place] = vertex;
    }
    ladder.number_layer(layer);
}

/// Exchanges neighbours within their layers while that saves crossings.
fn exchange(ladder: &mut Ladder) {
    for _ in 0..EXCHANGES {
        let mut saved = false;
        for layer in 0..ladder.layers.len() {
            for place in 1..ladder.layers[layer].len() {
                let (left, right) = (ladder.layers[layer][place - 1], ladder.layers[layer][place]);
                let mut balance = 0_i64;
                for neighbours in [&ladder.above, &ladder.below] {
                    balance += pair(&ladder.position, &neighbours[left], &neighbours[right]);
                    balance -= pair(&ladder.position, &neighbours[right], &neighbours[left]);
                }
                if balance > 0 {
                    ladder.layers[layer].swap(place - 1, place);
                    ladder.position.swap(left, right);
                    saved = true;
                }
            }
        }
        if !saved {
            break;
        }
    }
}

/// Crossings of the lines of two vertices that stand side by side, the first to the left.
fn pair(position: &[usize], left: &[usize], right: &[usize]) -> i64 {
    // Lines to vertices in ascending order on both sides, so that one walk over both counts.
    let sorted = |side: &[usize]| {
        let mut places: Vec<usize> = side.iter().map(|next| position[*next]).collect();
        places.sort_unstable();
        places
    };
    let (left, right) = (sorted(left), sorted(right));
    let mut passed = 0;
    let mut count = 0;
    for place in left {
        while right.get(passed).is_some_and(|other| *other < place) {
            passed += 1;
        }
        count += passed as i64;
    }
    count
}

/// All crossings.
fn crossings(ladder: &Ladder) -> u64 {
    let mut count = 0;
    for [upper, lower] in ladder.layers.array_windows() {
        let mut seen = vec![0_u64; lower.len() + 1];
        let mut lines = 0;
        for vertex in upper {
            let mut ends: Vec<usize> = ladder.below[*vertex]
                .iter()
                .map(|next| ladder.position[*next])
                .collect();
            ends.sort_unstable();
            for end in &ends {
                let mut index = end + 1;
                let mut not_to_the_right = 0;
                while index > 0 {
                    not_to_the_right += seen[index];
                    index &= index - 1;
                }
                count += lines - not_to_the_right;
            }
            for end in ends {
                lines += 1;
                let mut index = end + 1;
                while index < seen.len() {
                    seen[index] += 1;
                    index += index & index.wrapping_neg();
                }
            }
        }
    }
    count
}
