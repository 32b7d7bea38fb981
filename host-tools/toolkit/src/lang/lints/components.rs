//! Circles in directed graphs.

/// Gives each node the number of its strongly connected component: two nodes have the same number
/// exactly if a way leads from each to the other. `edges[n]` lists where the edges from node `n`
/// lead. After Tarjan (1972), with a stack of its own, in time linear in nodes and edges.
pub(super) fn strongly_connected(edges: &[Vec<usize>]) -> Vec<usize> {
    const UNSEEN: usize = usize::MAX;
    let count = edges.len();
    let mut order = vec![UNSEEN; count];
    let mut lowest = vec![0; count];
    let mut component = vec![UNSEEN; count];
    let mut open: Vec<usize> = Vec::new();
    let mut way: Vec<(usize, usize)> = Vec::new();
    let mut seen = 0;
    let mut components = 0;
    for start in 0..count {
        if order[start] != UNSEEN {
            continue;
        }
        way.push((start, 0));
        while let Some((node, next)) = way.last_mut() {
            let node = *node;
            if *next == 0 {
                order[node] = seen;
                lowest[node] = seen;
                seen += 1;
                open.push(node);
            }
            let target = edges[node].get(*next).copied();
            *next += 1;
            match target {
                Some(target) if order[target] == UNSEEN => way.push((target, 0)),
                Some(target) if component[target] == UNSEEN => {
                    lowest[node] = lowest[node].min(order[target]);
                }
                Some(_) => {}
                None => {
                    way.pop();
                    if let Some(&(before, _)) = way.last() {
                        lowest[before] = lowest[before].min(lowest[node]);
                    }
                    if lowest[node] == order[node] {
                        while let Some(member) = open.pop() {
                            component[member] = components;
                            if member == node {
                                break;
                            }
                        }
                        components += 1;
                    }
                }
            }
        }
    }
    component
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whether a way of one edge or more leads from each node to each, the slow way.
    fn reaches(edges: &[Vec<usize>]) -> Vec<Vec<bool>> {
        let mut reaches = vec![vec![false; edges.len()]; edges.len()];
        for (node, targets) in edges.iter().enumerate() {
            for &target in targets {
                reaches[node][target] = true;
            }
        }
        for over in 0..edges.len() {
            for from in 0..edges.len() {
                for to in 0..edges.len() {
                    reaches[from][to] |= reaches[from][over] && reaches[over][to];
                }
            }
        }
        reaches
    }

    proptest! {
        #[test]
        fn nodes_are_together_exactly_if_ways_lead_both_ways(
            edges in (1_usize..12).prop_flat_map(|count| {
                prop::collection::vec(prop::collection::vec(0..count, 0..4), count)
            })
        ) {
            let component = strongly_connected(&edges);
            let reaches = reaches(&edges);
            for a in 0..edges.len() {
                for b in 0..edges.len() {
                    let together = a == b || (reaches[a][b] && reaches[b][a]);
                    prop_assert_eq!(component[a] == component[b], together, "{} {} in {:?}", a, b, edges);
                }
            }
        }
    }
}
