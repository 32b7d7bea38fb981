//! A report for people.

use std::fmt::{Display, Formatter, Result};

use super::{ContainerTable, RegionTable, Report, StateRow, TransitionRow};

/// Rows whose columns line up: each as wide as its widest cell.
struct Columns<const N: usize> {
    rows: Vec<[String; N]>,
}

impl<const N: usize> Columns<N> {
    fn new(titles: [&str; N]) -> Self {
        Self {
            rows: vec![titles.map(str::to_owned)],
        }
    }
}

impl<const N: usize> Display for Columns<N> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut widths = [0; N];
        for row in &self.rows {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = cell.chars().count().max(*width);
            }
        }
        for row in &self.rows {
            let cells = row.iter().zip(widths);
            let line: Vec<_> = cells
                .map(|(cell, width)| format!("{cell:<width$}"))
                .collect();
            writeln!(f, "  {}", line.join("  ").trim_end())?;
        }
        Ok(())
    }
}

impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let counts = &self.counts;
        writeln!(
            f,
            "mission {}: machine {}, {} bytes",
            self.hash, self.machine, counts.bytes
        )?;
        if !self.has_names {
            writeln!(f, "  names were left out; these are made up")?;
        }
        writeln!(
            f,
            "  {} states, {} transitions ({:.1} bytes each), {} containers, {} instances",
            counts.states,
            counts.transitions,
            self.bytes_per_transition,
            counts.containers,
            counts.instances
        )?;
        writeln!(
            f,
            "  {} events, {} flags, event queue of {}; {} bytes of RAM",
            counts.events, counts.flags, self.queue, counts.ram_bytes
        )?;

        let mut slots = Columns::new(["slot", "start us", "period us", "duration us", ""]);
        for slot in &self.slots {
            let runs_interpreter = slot.slot == self.interpreter_slot;
            slots.rows.push([
                slot.slot.to_string(),
                slot.start_us.to_string(),
                slot.period_us.to_string(),
                slot.duration_us.to_string(),
                if runs_interpreter { "interpreter" } else { "" }.to_owned(),
            ]);
        }
        write!(f, "\nslots\n{slots}")?;

        if !self.tasks.is_empty() {
            let mut tasks = Columns::new(["hash", "exclusive", "signature"]);
            for task in &self.tasks {
                tasks.rows.push([
                    task.hash.clone(),
                    task.exclusive.clone().unwrap_or_default(),
                    task.signature.clone(),
                ]);
            }
            write!(f, "\ntasks\n{tasks}")?;
        }
        for container in &self.container_tables {
            write!(f, "\n{container}")?;
        }
        if !self.task_states.is_empty() {
            let mut rows = Columns::new(["task state", "task", "slot", "nets"]);
            for row in &self.task_states {
                let net = |(port, net): &(String, Option<usize>)| match net {
                    Some(net) => format!("{port}={net}"),
                    None => format!("{port}=open"),
                };
                let nets: Vec<_> = row.nets.iter().map(net).collect();
                rows.rows.push([
                    row.path.clone(),
                    row.task.clone(),
                    row.slot.to_string(),
                    nets.join(" "),
                ]);
            }
            write!(f, "\ntask states, in the order in which they run\n{rows}")?;
        }
        if !self.nets.is_empty() {
            let mut rows = Columns::new(["net", "type", "from", "to"]);
            for (index, net) in self.nets.iter().enumerate() {
                rows.rows.push([
                    index.to_string(),
                    net.type_name.clone(),
                    net.writers.join(", "),
                    net.readers.join(", "),
                ]);
            }
            write!(f, "\nnets\n{rows}")?;
        }
        for link in &self.links {
            let mut rows = Columns::new([
                "frame",
                "id",
                "",
                "carries",
                "bytes",
                "period us",
                "start us",
                "late us",
            ]);
            let number = |us: Option<u32>| us.map_or_else(String::new, |us| us.to_string());
            for frame in &link.frames {
                rows.rows.push([
                    frame.frame.clone(),
                    frame.id.to_string(),
                    frame.direction.to_owned(),
                    match &frame.type_name {
                        Some(type_name) => type_name.clone(),
                        None => format!("flags {}", frame.flags.join(", ")),
                    },
                    frame.payload_bytes.to_string(),
                    frame.period_us.to_string(),
                    number(frame.start_us),
                    number(frame.late_us),
                ]);
            }
            write!(
                f,
                "\nlink {}, {} bits a second, {} bits a byte, header {} bytes, gap {} us\n{rows}",
                link.link, link.rate_bps, link.bits, link.header_bytes, link.gap_us
            )?;
        }
        Ok(())
    }
}

impl Display for ContainerTable {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "container {}", self.name)?;
        if self.instances > 1 {
            write!(f, ", {} times", self.instances)?;
        }
        if !self.flags.is_empty() {
            write!(f, ", flags {}", self.flags.join(", "))?;
        }
        writeln!(f)?;
        self.regions
            .iter()
            .try_for_each(|region| write!(f, "{region}"))
    }
}

impl Display for RegionTable {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "  region {}", self.name)?;
        for state in &self.states {
            writeln!(f, "    {state}")?;
        }
        for transition in &self.transitions {
            writeln!(f, "    {transition}")?;
        }
        Ok(())
    }
}

impl Display for StateRow {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{} {}", self.kind, self.name)?;
        if let Some(of) = &self.of {
            write!(f, ": {of}")?;
        }
        if let Some(slot) = self.slot {
            write!(f, " slot {slot}")?;
        }
        if let Some(timeout_us) = self.timeout_us {
            write!(f, " timeout {timeout_us} us")?;
        }
        let params = self.params.iter();
        let params: Vec<_> = params
            .map(|(name, value)| format!("{name} = {value}"))
            .collect();
        if !params.is_empty() {
            write!(f, " with {{ {} }}", params.join(", "))?;
        }
        Ok(())
    }
}

impl Display for TransitionRow {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{} -> {} on {}", self.from, self.to, self.event)?;
        if let Some(guard) = &self.guard {
            write!(f, " [{guard}]")?;
        }
        if !self.actions.is_empty() {
            write!(f, " / {}", self.actions.join(", "))?;
        }
        Ok(())
    }
}
