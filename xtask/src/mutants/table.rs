//! Tables of mutants.
//!
//! ```text
//! package rt-firmware                 the folder of the package, and features that its tests need
//! features keys black-box
//!
//! test store::erases::                tests that must notice what follows: one, or all of a module
//! with ESM_RECORD_DAMAGES=small       what they are run with
//! file rt-firmware/src/store/mod.rs   where the next changes are
//!
//! mutant TailForgotten: the last bytes are not written
//! after fn finish                     the text is looked for behind this one
//! - !received.is_multiple_of(8)       an expression, which is there once
//! + false                             and what takes its place
//! ```
//!
//! `test`, `with` and `file` hold until the next one; `with` ends with the next `test`. A mutant
//! has one change or several. Texts of several lines have a sign on each. Blanks and ends of lines
//! do not count where texts are compared. A line that begins with `#` is a comment.

/// The mutants of a package.
#[derive(Debug, Default, PartialEq)]
pub struct Table {
    /// The package's folder.
    pub package: String,
    pub features: Vec<String>,
    pub mutants: Vec<Mutant>,
}

impl Table {
    /// The package's name in lists.
    pub fn short(&self) -> &str {
        self.package.rsplit('/').next().unwrap_or_default()
    }
}

/// A change for the worse.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mutant {
    pub name: String,
    /// What goes wrong.
    pub what: String,
    /// The test that must fail; a name that ends with `::` stands for the tests of a module.
    pub test: String,
    /// Variables of the environment.
    pub variables: Vec<(String, String)>,
    pub changes: Vec<Change>,
}

impl Mutant {
    /// Whether this test is to notice it.
    pub fn is_noticed_by(&self, test: &str) -> bool {
        match self.test.ends_with("::") {
            true => test.starts_with(&self.test),
            false => test == self.test,
        }
    }
}

/// One text in the place of another.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// The line of the table.
    pub line: usize,
    pub file: String,
    /// The text is looked for behind this one.
    pub after: Option<String>,
    pub old: String,
    pub new: String,
}

/// What is wrong in which line.
type Problem = (usize, String);

impl Table {
    /// Reads a table.
    ///
    /// # Errors
    /// The first line that is wrong, and why.
    pub fn parse(text: &str) -> Result<Table, Problem> {
        let mut table = Table::default();
        let (mut test, mut variables, mut file) = (String::new(), Vec::new(), String::new());
        let mut after = None;
        for (number, line) in (1..).zip(text.lines()) {
            let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
            let wrong = |problem: &str| Err((number, problem.to_owned()));
            match word {
                "package" => rest.clone_into(&mut table.package),
                "features" => table.features = rest.split(' ').map(str::to_owned).collect(),
                "test" => {
                    rest.clone_into(&mut test);
                    variables.clear();
                }
                "with" => match rest.split_once('=') {
                    Some((name, value)) => variables.push((name.to_owned(), value.to_owned())),
                    None => return wrong("a variable has a name, `=` and a value"),
                },
                "file" => rest.clone_into(&mut file),
                "mutant" => {
                    let Some((name, what)) = rest.split_once(": ") else {
                        return wrong("a mutant has a name, a colon, and what goes wrong");
                    };
                    if table.mutants.iter().any(|mutant| mutant.name == name) {
                        return wrong("another mutant has this name");
                    }
                    table.mutants.push(Mutant {
                        name: name.to_owned(),
                        what: what.to_owned(),
                        test: test.clone(),
                        variables: variables.clone(),
                        changes: Vec::new(),
                    });
                    after = None;
                }
                "after" => after = Some(rest.to_owned()),
                "-" | "+" => {
                    let Some(mutant) = table.mutants.last_mut() else {
                        return wrong("a change belongs behind a mutant");
                    };
                    // A text behind a new one begins the next change.
                    let is_next = (mutant.changes.last())
                        .is_none_or(|change| word == "-" && !change.new.is_empty());
                    if is_next {
                        mutant.changes.push(Change {
                            line: number,
                            file: file.clone(),
                            after: after.take(),
                            ..Change::default()
                        });
                    }
                    if let Some(change) = mutant.changes.last_mut() {
                        let text = match word {
                            "-" => &mut change.old,
                            _ => &mut change.new,
                        };
                        *text += rest;
                        text.push('\n');
                    }
                }
                _ if line.is_empty() || word.starts_with('#') => {}
                _ => return wrong("begins with no word that a table knows"),
            }
        }
        for mutant in &table.mutants {
            let is_whole = |change: &Change| {
                !(change.old.is_empty() || change.new.is_empty() || change.file.is_empty())
            };
            if mutant.test.is_empty()
                || mutant.changes.is_empty()
                || !mutant.changes.iter().all(is_whole)
            {
                let line = mutant.changes.first().map_or(1, |change| change.line);
                let problem = format!("{} lacks a test, a file, or a text", mutant.name);
                return Err((line, problem));
            }
        }
        match table.package.is_empty() {
            true => Err((1, "names no package".to_owned())),
            false => Ok(table),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Table;

    #[test]
    fn a_table_is_read() {
        let table = Table::parse(
            "# a comment\npackage a/b\nfeatures x y\n\ntest m::t\nfile a/b/src/lib.rs\n\
             mutant One: wrong\nafter fn f\n- old\n- text\n+ new\n- two\n+ three\n\
             test n::\nwith A=b\nmutant Two: worse\n- o\n+ n\n",
        )
        .unwrap();
        assert_eq!((&*table.package, table.short()), ("a/b", "b"));
        assert_eq!(table.features, ["x", "y"]);
        let [one, two] = &table.mutants[..] else {
            panic!("{table:?}");
        };
        assert_eq!(
            (&*one.name, &*one.what, &*one.test),
            ("One", "wrong", "m::t")
        );
        let [first, second] = &one.changes[..] else {
            panic!("{one:?}");
        };
        assert_eq!((&*first.old, &*first.new), ("old\ntext\n", "new\n"));
        assert_eq!(first.after.as_deref(), Some("fn f"));
        assert_eq!((&*second.old, second.after.as_deref()), ("two\n", None));
        assert_eq!(two.variables, [("A".to_owned(), "b".to_owned())]);
        assert_eq!(two.changes[0].file, "a/b/src/lib.rs");
    }

    #[test]
    fn what_is_wrong_in_a_table_is_told_with_its_line() {
        for (text, line, problem) in [
            ("package a\nmutat A: b", 2, "no word"),
            ("package a\n- b", 2, "behind a mutant"),
            ("package a\nmutant A", 2, "a colon"),
            ("package a\nmutant A: b", 1, "lacks a test"),
            (
                "package a\ntest t\nfile f\nmutant A: b\n- c",
                5,
                "lacks a test",
            ),
            ("test t\nfile f\nmutant A: b\n- c\n+ d", 1, "no package"),
            ("package a\nmutant A: b\nmutant A: c", 3, "another mutant"),
        ] {
            let (found, told) = Table::parse(text).unwrap_err();
            assert_eq!(found, line, "{text}: {told}");
            assert!(told.contains(problem), "{text}: {told}");
        }
    }
}
