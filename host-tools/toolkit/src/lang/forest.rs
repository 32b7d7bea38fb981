//! Sets that only grow together, such as the ports that share a net.

/// Sets of nodes that grow together: each node points towards the one that stands for its set.
#[derive(Debug, Default)]
pub(super) struct Forest {
    parent: Vec<usize>,
}

impl Forest {
    /// How many nodes there are.
    pub(super) fn len(&self) -> usize {
        self.parent.len()
    }

    /// Adds a node that stands for itself.
    pub(super) fn add(&mut self) -> usize {
        let node = self.parent.len();
        self.parent.push(node);
        node
    }

    /// The node that stands for the set of a node.
    pub(super) fn root(&mut self, mut node: usize) -> usize {
        while let Some(&parent) = self.parent.get(node) {
            if parent == node {
                break;
            }
            // Halving the way keeps later ones short.
            let grandparent = self.parent.get(parent).copied().unwrap_or(parent);
            if let Some(slot) = self.parent.get_mut(node) {
                *slot = grandparent;
            }
            node = grandparent;
        }
        node
    }

    /// Joins two sets. Gives the node that stands for both and the one that no longer stands for
    /// any, if they were two.
    pub(super) fn join(&mut self, a: usize, b: usize) -> Option<(usize, usize)> {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return None;
        }
        let (keep, drop) = (a.min(b), a.max(b));
        *self.parent.get_mut(drop)? = keep;
        Some((keep, drop))
    }
}
