//! The instance tree with its edges: who is around and inside whom.

use esm_core::tables::{Instance, Tables};

/// Container instances by number, and the numbers of each container's instances.
pub(super) struct Tree {
    pub(super) instances: Vec<Instance>,
    /// The instance around each; that of the machine is itself.
    pub(super) around: Vec<usize>,
    /// The instances inside the superstates of each.
    pub(super) inside: Vec<Vec<usize>>,
    /// The instances of each container.
    pub(super) of_containers: Vec<Vec<usize>>,
    /// How many instances one of each container is, with all inside.
    spans: Vec<usize>,
}

impl Tree {
    pub(super) fn of(tables: &Tables<'_>) -> Self {
        let count = tables.instance_count();
        let containers = tables.containers();
        let mut tree = Self {
            instances: Vec::with_capacity(count),
            around: Vec::with_capacity(count),
            inside: vec![Vec::new(); count],
            of_containers: vec![Vec::new(); containers.len()],
            spans: containers
                .map(|container| container.instance_span)
                .collect(),
        };
        for (index, instance) in
            (0..count).filter_map(|index| Some((index, tables.instance(index)?)))
        {
            let around = match tables.region_instance(instance.around) {
                Some(region) if index > 0 => region.instance,
                _ => 0,
            };
            if let Some(list) = tree.of_containers.get_mut(instance.container) {
                list.push(index);
            }
            if let (true, Some(inside)) = (index > 0, tree.inside.get_mut(around)) {
                inside.push(index);
            }
            tree.around.push(around);
            tree.instances.push(instance);
        }
        tree
    }

    /// The container of an instance.
    pub(super) fn container(&self, instance: usize) -> usize {
        self.instances
            .get(instance)
            .map_or(0, |instance| instance.container)
    }

    /// The instance around one; that of the machine is itself.
    pub(super) fn around(&self, instance: usize) -> usize {
        self.around.get(instance).copied().unwrap_or(0)
    }

    /// Whether `inner` is `outer` or anywhere inside it: instances are numbered depth first.
    pub(super) fn holds(&self, outer: usize, inner: usize) -> bool {
        let span = self.spans.get(self.container(outer)).copied().unwrap_or(1);
        outer <= inner && inner - outer < span
    }
}
