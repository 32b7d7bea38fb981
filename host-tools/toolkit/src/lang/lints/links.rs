//! W107: links without a task state, and frames whose port and flags nobody uses.

use crate::lang::diagnostic::Sink;
use crate::model::{Content, Direction, Model};

use super::unused::{Users, remove, unused};

/// Reports links and frames that do nothing. `ports` says of each task which of its ports are used.
pub(super) fn check(model: &Model, users: &Users, ports: &[Vec<bool>], sink: &mut Sink) {
    for (index, link) in model.links.iter().enumerate() {
        let dispatchers = [link.transmit, link.receive].map(|task| users.tasks.get(task));
        let [Some(transmit), Some(receive)] = dispatchers else {
            continue;
        };
        if transmit.may_be_more || receive.may_be_more {
            continue;
        }
        if !transmit.is_used && !receive.is_used {
            let name = &link.name;
            let message = format!("link `{name}` has no task state");
            let hint = format!(
                "send or receive in one, `task Link: {name}.transmit slot 1;`, or remove the link and its frames"
            );
            sink.push(unused(link.declaration, message).hint(hint));
            continue;
        }
        check_frames(model, index, users, ports, sink);
    }
}

fn check_frames(model: &Model, link: usize, users: &Users, ports: &[Vec<bool>], sink: &mut Sink) {
    for frame in model.frames.iter().filter(|frame| frame.link == link) {
        let Some(link) = model.links.get(frame.link) else {
            continue;
        };
        let task = match frame.direction {
            Direction::Out => link.transmit,
            _ => link.receive,
        };
        let (Some(user), Some(ports), Some(task)) = (
            users.tasks.get(task),
            ports.get(task),
            model.tasks.get(task),
        ) else {
            continue;
        };
        let is_flag_used = |name: &str| {
            let flags = task.flags.iter().zip(&user.flags);
            flags
                .into_iter()
                .any(|(flag, used)| flag.name == name && *used)
        };
        let own = match &frame.content {
            Content::Value(_) => {
                let mut ports = task.data.iter().zip(ports);
                ports.any(|(port, used)| port.name == frame.name && *used)
            }
            Content::Flags(flags) => flags.iter().any(|flag| is_flag_used(flag)),
        };
        let by_itself = ["full", "available", "delayed"];
        let mut by_itself = by_itself
            .iter()
            .map(|what| format!("{}_{what}", frame.name));
        if !own && !by_itself.any(|flag| is_flag_used(&flag)) {
            let name = &frame.name;
            let (message, hint) = match &frame.content {
                Content::Value(_) => (
                    format!("nobody uses port `{name}` of frame `{name}`"),
                    format!(
                        "write `path` with it where `{}` is used, or remove the frame",
                        task.name
                    ),
                ),
                Content::Flags(_) => (
                    format!("nobody uses a flag of frame `{name}`"),
                    format!(
                        "set or read one at a state of `{}`, or remove the frame",
                        task.name
                    ),
                ),
            };
            let diagnostic = unused(frame.declaration, message).hint(hint);
            sink.push(diagnostic.fix(remove("remove the frame", frame.declaration, model)));
        }
    }
}
