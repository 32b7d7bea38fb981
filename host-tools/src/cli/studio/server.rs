//! The server of the page: on the loopback alone, for who has the token, and for the page itself.

use std::io::{self, Write};
use std::net::Ipv4Addr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tiny_http::{Method, Request, Server, StatusCode};

use super::site::Site;

/// How often is looked whether it is to end.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Name of what a page asks for news of the robot.
const LIVE: &str = "live";

/// What answers a page's question for news of the robot.
pub trait Answers: Sync {
    /// The answer to a question; none where there is nothing new, unless one is due.
    fn answer(&self, query: &str, is_due: bool) -> Option<Vec<u8>>;
}

/// How long a page waits for news of the robot, before it is told that there are none.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// Requests for news of the robot that wait at most: a page has one. More are answered at once.
const MOST_WAITING: usize = 16;

/// The type of what is no text.
const BINARY: &str = "application/octet-stream";

/// Bytes of the token: nobody guesses so many.
const TOKEN_BYTES: usize = 16;

/// What the page may do: run what comes from here, and nothing else.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'; object-src 'none'";

/// Headers of each answer.
const HEADERS: [(&str, &str); 6] = [
    ("Content-Security-Policy", POLICY),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Cache-Control", "no-store"),
];

/// What is asked for, as far as it decides the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Asked<'a> {
    is_read: bool,
    path: &'a str,
    host: Option<&'a str>,
    origin: Option<&'a str>,
}

/// What is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Answer<'a> {
    /// The file of this name.
    File(&'a str),
    /// Who asks is none of those whom this is for.
    Forbidden,
    /// There is no such thing.
    NotFound,
    /// Nothing here is written to.
    NotAllowed,
}

/// Who may ask, and under which address.
#[derive(Clone, Debug)]
struct Door {
    token: String,
    hosts: [String; 2],
}

impl Door {
    fn new(token: String, port: u16) -> Self {
        Door {
            token,
            hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")],
        }
    }

    /// A page of another origin, or one that another name was bent to this address for, gets
    /// nothing, whatever it knows.
    fn answer<'a>(&self, asked: &Asked<'a>) -> Answer<'a> {
        let is_known = |host: &str| self.hosts.iter().any(|known| known == host);
        let is_own = |origin: &str| origin.strip_prefix("http://").is_some_and(is_known);
        if !asked.host.is_some_and(is_known) || !asked.origin.is_none_or(is_own) {
            return Answer::Forbidden;
        }
        let path = asked.path.split(['?', '#']).next().unwrap_or_default();
        let name = (path.strip_prefix('/')).and_then(|rest| rest.strip_prefix(&self.token));
        match name.and_then(|rest| rest.strip_prefix('/')) {
            None => Answer::Forbidden,
            Some(_) if !asked.is_read => Answer::NotAllowed,
            Some(name) => Answer::File(name),
        }
    }
}

/// A request for news of the robot.
struct Waiting {
    query: String,
    request: Request,
    since: Instant,
}

/// A server that listens.
pub struct Listener {
    server: Server,
    door: Door,
    port: u16,
    /// Whether it was woken and has not looked yet.
    is_woken: AtomicBool,
}

impl Listener {
    /// Listens at a port of the loopback; at any that is free, for 0.
    ///
    /// # Errors
    /// The port is taken, or the system has no random bytes.
    pub fn bind(port: u16) -> io::Result<Self> {
        let server = Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|error| match error
            .downcast::<io::Error>()
        {
            Ok(error) => *error,
            Err(error) => io::Error::other(error),
        })?;
        let port = server.server_addr().to_ip().map_or(port, |at| at.port());
        let mut random = [0; TOKEN_BYTES];
        getrandom::fill(&mut random).map_err(io::Error::other)?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Listener {
            server,
            door: Door::new(token, port),
            port,
            is_woken: AtomicBool::new(false),
        })
    }

    /// The address of the page.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.door.token)
    }

    /// Serves the page until it is to end; of a robot, too, where there is one.
    ///
    /// # Errors
    /// The system takes the port away.
    pub fn serve(
        &self,
        site: &Site,
        robot: Option<&dyn Answers>,
        is_over: impl Fn() -> bool,
    ) -> io::Result<()> {
        let mut waiting: Vec<Waiting> = Vec::new();
        loop {
            self.is_woken.store(false, Ordering::Relaxed);
            let ends = is_over();
            if let Some(robot) = robot {
                let asked = std::mem::take(&mut waiting);
                let first = asked.len().saturating_sub(MOST_WAITING);
                for (number, one) in asked.into_iter().enumerate() {
                    let is_due = ends || number < first || one.since.elapsed() >= LONGEST_WAIT;
                    match robot.answer(&one.query, is_due) {
                        // Whoever asked may have gone.
                        Some(bytes) => drop(send(one.request, 200, BINARY, &bytes)),
                        None => waiting.push(one),
                    }
                }
            }
            if ends {
                return Ok(());
            }
            let Some(request) = self.server.recv_timeout(LOOK_INTERVAL)? else {
                continue;
            };
            // Whoever asked may have gone.
            if let Ok(Some(asked)) = self.respond(request, site, robot.is_some()) {
                waiting.push(asked);
            }
        }
    }

    /// Lets the server look for what is new of the robot.
    pub fn wake(&self) {
        // Once is enough: those that it has not come to yet would be kept.
        if !self.is_woken.swap(true, Ordering::Relaxed) {
            self.server.unblock();
        }
    }

    /// Answers a request; one for what is new of the robot comes back, to be answered when there is
    /// something.
    fn respond(
        &self,
        request: Request,
        site: &Site,
        has_robot: bool,
    ) -> io::Result<Option<Waiting>> {
        let header = |name: &'static str| {
            let mut headers = request.headers().iter();
            let found = headers.find(|header| header.field.equiv(name));
            found.map(|header| header.value.as_str())
        };
        let asked = Asked {
            is_read: matches!(request.method(), Method::Get | Method::Head),
            path: request.url(),
            host: header("Host"),
            origin: header("Origin"),
        };
        let (status, kind, bytes) = match self.door.answer(&asked) {
            Answer::File(LIVE) if has_robot => {
                let query = (asked.path.split_once('?')).map_or("", |(_, query)| query);
                return Ok(Some(Waiting {
                    query: query.to_owned(),
                    request,
                    since: Instant::now(),
                }));
            }
            Answer::File(name) => match site.file(name) {
                Some((kind, bytes)) => (200, kind, bytes),
                None => refusal(Answer::NotFound),
            },
            other => refusal(other),
        };
        send(request, status, kind, bytes)?;
        Ok(None)
    }
}

/// Answers a request, and has the client end the connection. One that stayed open would keep a
/// thread of the server's, and a page that opens several at once would wait for it: for minutes,
/// as long as browsers keep connections.
fn send(request: Request, status: u16, kind: &str, bytes: &[u8]) -> io::Result<()> {
    let has_body = *request.method() != Method::Head;
    let reason = StatusCode(status).default_reason_phrase();
    let mut head = format!("HTTP/1.1 {status} {reason}\r\n");
    let length = bytes.len().to_string();
    let own = [
        ("Content-Type", kind),
        ("Content-Length", length.as_str()),
        ("Connection", "close"),
    ];
    for (name, value) in HEADERS.into_iter().chain(own) {
        head += &format!("{name}: {value}\r\n");
    }
    head += "\r\n";
    let mut out = request.into_writer();
    out.write_all(head.as_bytes())?;
    if has_body {
        out.write_all(bytes)?;
    }
    out.flush()
}

fn refusal(answer: Answer<'_>) -> (u16, &'static str, &'static [u8]) {
    const KIND: &str = "text/plain; charset=utf-8";
    match answer {
        Answer::NotFound | Answer::File(_) => (404, KIND, b"there is no such file here\n"),
        Answer::NotAllowed => (405, KIND, b"nothing here is written to\n"),
        Answer::Forbidden => (
            403,
            KIND,
            b"open the address that `esm studio` has printed, with all that is in it\n",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_page_itself_gets_an_answer() {
        let door = Door::new("secret".to_owned(), 4000);
        let ask = |path, host, origin| {
            door.answer(&Asked {
                is_read: true,
                path,
                host,
                origin,
            })
        };
        let here = Some("127.0.0.1:4000");
        for (path, host, origin, expected) in [
            ("/secret/", here, None, Answer::File("")),
            ("/secret/a.js?x", here, None, Answer::File("a.js")),
            ("/secret/", Some("localhost:4000"), None, Answer::File("")),
            (
                "/secret/",
                here,
                Some("http://127.0.0.1:4000"),
                Answer::File(""),
            ),
            ("/", here, None, Answer::Forbidden),
            ("/secret", here, None, Answer::Forbidden),
            ("/secre/", here, None, Answer::Forbidden),
            ("//secret/", here, None, Answer::Forbidden),
            ("/secret/", None, None, Answer::Forbidden),
            (
                "/secret/",
                Some("evil.example:4000"),
                None,
                Answer::Forbidden,
            ),
            ("/secret/", Some("127.0.0.1:4001"), None, Answer::Forbidden),
            (
                "/secret/",
                here,
                Some("http://evil.example"),
                Answer::Forbidden,
            ),
            ("/secret/", here, Some("null"), Answer::Forbidden),
            (
                "/secret/",
                here,
                Some("https://127.0.0.1:4000"),
                Answer::Forbidden,
            ),
        ] {
            assert_eq!(
                ask(path, host, origin),
                expected,
                "{path} {host:?} {origin:?}"
            );
        }
        let written = door.answer(&Asked {
            is_read: false,
            path: "/secret/",
            host: here,
            origin: None,
        });
        assert_eq!(written, Answer::NotAllowed);
    }
}
