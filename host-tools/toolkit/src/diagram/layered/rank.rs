//! Which node stands in which rank, so that most transitions lead downwards and few are long.
//!
//! A machine goes round in circles, a layered drawing does not: some edges are drawn upwards.
//! Several orders of the nodes are tried (edges against the order are the ones that point up), and
//! the one that makes the edges shortest in all is taken. For each, ranks are longest paths from
//! the top (Sugiyama, Tagawa, Toda 1981), and nodes then move towards the side on which they have
//! more neighbours (after Gansner, Koutsofios, North, Vo 1993).

use std::collections::VecDeque;

/// The ranks of a graph's nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ranking {
    /// For each node its rank; 0 is the top.
    pub rank: Vec<usize>,
}

/// How often all nodes are offered a better rank. Chains of moves longer than this are rare, and
/// cost only length.
const TIGHTENING_ROUNDS: usize = 12;

/// Ranks `nodes` nodes so that no edge stays within a rank. Edges from a node to itself are not
/// among `edges`.
pub fn ranks(nodes: usize, edges: &[[usize; 2]]) -> Ranking {
    let mut leaving = vec![Vec::new(); nodes];
    for [from, to] in edges {
        leaving[*from].push(*to);
    }
    let candidates = [
        (0..nodes).collect(),
        breadth_first(&leaving),
        depth_first(&leaving),
    ];
    let rankings = candidates.into_iter().map(|order: Vec<usize>| {
        let mut position = vec![0; nodes];
        for (index, node) in order.iter().enumerate() {
            position[*node] = index;
        }
        let rank = tightened(&order, &position, edges);
        let length: usize = edges
            .iter()
            .map(|[from, to]| rank[*from].abs_diff(rank[*to]))
            .sum();
        let upwards = edges.iter().filter(|[from, to]| rank[*from] > rank[*to]);
        let height = rank.iter().max().copied().unwrap_or(0);
        // Length is what makes a drawing tangled; height and direction decide where that is equal
        // or nearly so.
        (2 * length + upwards.count() + 2 * height, Ranking { rank })
    });
    rankings
        .min_by_key(|(cost, _)| *cost)
        .map_or(Ranking { rank: Vec::new() }, |(_, ranking)| ranking)
}

/// The nodes in the order in which a walk by distance from the first meets them.
fn breadth_first(leaving: &[Vec<usize>]) -> Vec<usize> {
    let mut met = vec![false; leaving.len()];
    let mut order = Vec::with_capacity(leaving.len());
    let mut waiting = VecDeque::new();
    for start in 0..leaving.len() {
        if !std::mem::replace(&mut met[start], true) {
            waiting.push_back(start);
        }
        while let Some(node) = waiting.pop_front() {
            order.push(node);
            for next in &leaving[node] {
                if !std::mem::replace(&mut met[*next], true) {
                    waiting.push_back(*next);
                }
            }
        }
    }
    order
}

/// The nodes in an order in which only edges back into the present path of a depth-first walk point
/// backwards.
fn depth_first(leaving: &[Vec<usize>]) -> Vec<usize> {
    let mut met = vec![false; leaving.len()];
    let mut left = Vec::with_capacity(leaving.len());
    let mut path: Vec<(usize, usize)> = Vec::new();
    for start in 0..leaving.len() {
        if std::mem::replace(&mut met[start], true) {
            continue;
        }
        path.push((start, 0));
        while let Some((node, tried)) = path.last_mut() {
            match leaving[*node].get(*tried) {
                Some(next) => {
                    *tried += 1;
                    if !std::mem::replace(&mut met[*next], true) {
                        path.push((*next, 0));
                    }
                }
                None => {
                    left.push(*node);
                    path.pop();
                }
            }
        }
    }
    left.reverse();
    left
}

/// Longest-path ranks along an order, then tightened.
fn tightened(order: &[usize], position: &[usize], edges: &[[usize; 2]]) -> Vec<usize> {
    let mut above = vec![Vec::new(); order.len()];
    let mut below = vec![Vec::new(); order.len()];
    for [from, to] in edges {
        let (upper, lower) = if position[*from] < position[*to] {
            (*from, *to)
        } else {
            (*to, *from)
        };
        above[lower].push(upper);
        below[upper].push(lower);
    }
    let mut rank = vec![0; order.len()];
    for node in order {
        rank[*node] = above[*node]
            .iter()
            .map(|upper| rank[*upper] + 1)
            .max()
            .unwrap_or(0);
    }
    for round in 0..TIGHTENING_ROUNDS {
        let mut moved = false;
        for step in 0..order.len() {
            let node = order[if round % 2 == 0 {
                order.len() - 1 - step
            } else {
                step
            }];
            let highest = above[node].iter().map(|upper| rank[*upper] + 1).max();
            let lowest = below[node].iter().map(|lower| rank[*lower] - 1).min();
            let wanted = match (highest, lowest) {
                (Some(highest), _) if above[node].len() > below[node].len() => highest,
                (_, Some(lowest)) if below[node].len() > above[node].len() => lowest,
                _ => continue,
            };
            moved |= rank[node] != wanted;
            rank[node] = wanted;
        }
        if !moved {
            break;
        }
    }
    let least = rank.iter().min().copied().unwrap_or(0);
    for value in &mut rank {
        *value -= least;
    }
    rank
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_cut_once_and_leads_down_from_its_start() {
        let ranking = ranks(4, &[[0, 1], [1, 2], [2, 3], [3, 1]]);
        assert_eq!(ranking.rank, [0, 1, 2, 3]);
    }

    #[test]
    fn what_only_leads_into_a_deep_node_stands_close_to_it() {
        // 3 has no predecessor; longest paths alone would leave it at the top.
        let ranking = ranks(5, &[[0, 1], [1, 2], [2, 4], [3, 4]]);
        assert_eq!(ranking.rank, [0, 1, 2, 2, 3]);
    }

    #[test]
    fn no_edge_stays_within_a_rank() {
        let mut seed = 1_u64;
        for _ in 0..200 {
            let edges: Vec<[usize; 2]> = (0..30)
                .map(|_| {
                    seed = seed
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    [(seed >> 33) as usize % 12, (seed >> 45) as usize % 12]
                })
                .filter(|[from, to]| from != to)
                .collect();
            let ranking = ranks(12, &edges);
            for [from, to] in &edges {
                assert_ne!(ranking.rank[*from], ranking.rank[*to], "{edges:?}");
            }
        }
    }
}
