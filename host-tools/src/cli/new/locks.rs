//! Lock files of a robot: those of an example, so that it is built with what the framework was
//! tested with.

/// What a package is called in the example, and in the robot.
#[derive(Clone, Copy)]
pub struct Rename<'a> {
    /// In the example.
    pub from: &'a str,
    /// In the robot.
    pub to: &'a str,
}

/// What stands between two packages.
const BETWEEN: &str = "\n[[package]]\n";

/// A lock file with the robot's name in place of the example's. The packages are in their order, so
/// that cargo leaves the file as it is.
pub fn renamed(lock: &str, rename: Rename<'_>) -> String {
    let lock = lock
        .replace(
            &format!("\"{}\"", rename.from),
            &format!("\"{}\"", rename.to),
        )
        .replace(
            &format!("\"{}_firmware\"", rename.from),
            &format!("\"{}_firmware\"", rename.to),
        );
    let mut parts = lock.split(BETWEEN);
    let head = parts.next().unwrap_or_default();
    let mut packages: Vec<&str> = parts
        .map(|package| package.trim_end_matches('\n'))
        .collect();
    let name = |package: &str| package.lines().next().map(str::to_owned);
    packages.sort_by_key(|package| name(package));
    let mut text = head.trim_end_matches('\n').to_owned() + "\n";
    for package in packages {
        text += BETWEEN;
        text += package;
        text += "\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_stands_where_cargo_puts_it() {
        let lock = "# This file is generated.\nversion = 4\n\
            \n[[package]]\nname = \"a\"\nversion = \"1.0.0\"\n\
            \n[[package]]\nname = \"my_robot\"\nversion = \"0.1.0\"\ndependencies = [\n \"a\",\n]\n\
            \n[[package]]\nname = \"my_robot_firmware\"\nversion = \"0.1.0\"\ndependencies = [\n \"my_robot\",\n]\n\
            \n[[package]]\nname = \"z\"\nversion = \"0.1.0\"\n";
        let same = Rename {
            from: "my_robot",
            to: "my_robot",
        };
        assert_eq!(renamed(lock, same), lock);
        let text = renamed(
            lock,
            Rename {
                from: "my_robot",
                to: "zebra",
            },
        );
        let names: Vec<&str> = text
            .lines()
            .filter(|line| line.starts_with("name"))
            .collect();
        assert_eq!(
            names,
            [
                "name = \"a\"",
                "name = \"z\"",
                "name = \"zebra\"",
                "name = \"zebra_firmware\""
            ]
        );
        assert!(text.contains(" \"zebra\",\n") && !text.contains("my_robot"));
    }
}
