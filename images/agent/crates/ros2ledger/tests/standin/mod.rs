//! A stand-in for ROS 2, built by the C compiler: `librmw_implementation.so` over memory,
//! `libtracetools.so`, and nodes like those of rclcpp and rclpy that are led by lines of text.
#![allow(dead_code, clippy::unwrap_used)] // Each of those who use it needs a part.

use std::ffi::OsStr;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;

use bagpipe_ros2ledger::{LIBRARY, Ledger};

/// How a node is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Client {
    /// A program linked to ROS, with tracepoints.
    Rclcpp,
    /// The same as a module that a program without ROS loads for itself alone.
    Component,
    /// Such a module without tracepoints.
    Rclpy,
    /// The same, loaded for all, that is loaded again when it has left.
    Again,
}

/// What the stand-in's rmw sends messages by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Middleware {
    /// The memory of one process.
    Memory,
    /// Debian's Cyclone DDS.
    Cyclone,
    /// None: waits go by a script, and by a clock that only waits move.
    Script,
    /// The memory of one process, of a ROS 2 that was built for one middleware: there is no
    /// librmw_implementation.so, and librcl is linked to that middleware.
    Only,
}

/// Where the programs over memory are.
pub fn built() -> &'static Path {
    built_over(Middleware::Memory)
}

/// Where the programs are: built when a source differs, in a folder that appears as a whole.
pub fn built_over(middleware: Middleware) -> &'static Path {
    static FOLDERS: [OnceLock<PathBuf>; 4] = [const { OnceLock::new() }; 4];
    FOLDERS[middleware as usize].get_or_init(|| {
        let parent = option_env!("CARGO_TARGET_TMPDIR").map_or_else(std::env::temp_dir, Into::into);
        let folder = parent.join(format!("ros2-standin-{middleware:?}-{:016x}", digest()));
        if !folder.exists() {
            let unfinished = format!("ros2-standin-{middleware:?}-{}", std::process::id());
            let unfinished = parent.join(unfinished);
            build(&unfinished, middleware);
            // Another process may have been faster.
            if std::fs::rename(&unfinished, &folder).is_err() {
                std::fs::remove_dir_all(&unfinished).unwrap();
            }
        }
        folder
    })
}

/// Of everything that the programs are built from.
fn digest() -> u64 {
    let mut hasher = DefaultHasher::new();
    let mut sources: Vec<_> =
        std::fs::read_dir(sources()).unwrap().map(|entry| entry.unwrap().path()).collect();
    sources.sort();
    for source in sources {
        std::fs::read(source).unwrap().hash(&mut hasher);
    }
    LIBRARY.hash(&mut hasher);
    hasher.finish()
}

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/standin")
}

fn build(folder: &Path, middleware: Middleware) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("ledger.so"), LIBRARY).unwrap();
    let library = ["-shared", "-fPIC", "-Wl,-z,now"];
    if middleware == Middleware::Script {
        compile(folder, "librmw_implementation.so", "script.c", &library);
        return compile(folder, "node", "waiter.c", &["-lrmw_implementation"]);
    }
    let (made, source, with) = match middleware {
        Middleware::Memory | Middleware::Script => ("rmw_implementation", "rmw.c", &[][..]),
        Middleware::Cyclone => ("rmw_implementation", "rmw_dds.c", &["-lddsc"][..]),
        Middleware::Only => ("rmw_standin", "rmw.c", &[][..]),
    };
    let file = format!("lib{made}.so");
    compile(folder, &file, source, &[&library[..], with].concat());
    compile(folder, "libtracetools.so", "tracetools.c", &library);
    let its = format!("-l{made}");
    compile(folder, "librcl.so", "rcl.c", &[&library[..], &["-Wl,--no-as-needed", &its]].concat());
    let rmw = [&its[..], "-lrcl"];
    let both = [&its[..], "-lrcl", "-ltracetools"];
    compile(folder, "node", "client.c", &both);
    compile(folder, "component.so", "client.c", &[&library[..], &both].concat());
    let without = [&library[..], &["-DWITHOUT_TRACEPOINTS"], &rmw].concat();
    compile(folder, "module.so", "client.c", &without);
    compile(folder, "host", "host.c", &[]);
}

fn compile(folder: &Path, made: &str, source: &str, flags: &[&str]) {
    let output = Command::new("cc")
        .args(["-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-pthread", "-o"])
        .arg(folder.join(made))
        .arg(sources().join(source))
        .arg(format!("-L{}", folder.display()))
        .arg("-Wl,-rpath,$ORIGIN")
        .arg(format!("-Wl,-soname,{made}"))
        .args(flags)
        .output()
        .unwrap();
    assert!(output.status.success(), "{made}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A node that runs; dropping it kills it.
pub struct Node {
    process: Child,
    lines: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Node {
    /// A node that counts in `ledger`.
    pub fn start(client: Client, ledger: &Ledger) -> Node {
        Node::with(client, &ledger.environment(&built().join("ledger.so"), None))
    }

    /// A node with these variables.
    pub fn with<V: AsRef<OsStr>>(client: Client, variables: &[(&str, V)]) -> Node {
        Node::in_folder(built(), client, variables)
    }

    /// One of the programs in a folder.
    pub fn in_folder<V: AsRef<OsStr>>(
        folder: &Path,
        client: Client,
        variables: &[(&str, V)],
    ) -> Node {
        let mut command = match client {
            Client::Rclcpp => Command::new(folder.join("node")),
            Client::Component | Client::Rclpy | Client::Again => Command::new(folder.join("host")),
        };
        match client {
            Client::Rclcpp => {}
            Client::Component => _ = command.arg(folder.join("component.so")),
            Client::Rclpy => _ = command.arg(folder.join("module.so")),
            Client::Again => _ = command.arg(folder.join("module.so")).arg("again"),
        }
        for (name, value) in variables {
            command.env(name, value);
        }
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let lines = process.stdin.take().unwrap();
        let answers = BufReader::new(process.stdout.take().unwrap());
        let mut node = Node { process, lines, answers };
        assert_eq!(node.answer(), "ready");
        node
    }

    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Does as the line says, and returns what the node answers.
    pub fn ask(&mut self, line: &str) -> String {
        self.send(line);
        self.answer()
    }

    /// Obeys each of these lines.
    pub fn obey(&mut self, lines: &[&str]) {
        for line in lines {
            assert_eq!(self.ask(line), "done", "{line}");
        }
    }

    pub fn send(&mut self, line: &str) {
        writeln!(self.lines, "{line}").unwrap();
    }

    pub fn answer(&mut self) -> String {
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    /// The node's own figures of the subscription on a topic.
    pub fn report(&mut self, topic: &str) -> Own {
        let answer = self.ask(&format!("report {topic}"));
        let words: Vec<&str> = answer.split(' ').collect();
        let figure = |name: &str| {
            let at = words.iter().position(|word| *word == name).unwrap();
            words[at + 1].parse().unwrap()
        };
        Own {
            taken: figure("taken"),
            called: figure("called"),
            intra: figure("intra"),
            overwritten: figure("overwritten"),
            waiting: figure("waiting"),
            traced: figure("traced"),
        }
    }

    /// By what a message's publisher is known, of the publisher on a topic.
    pub fn gid(&mut self, topic: &str) -> [u8; 16] {
        let number = u128::from_str_radix(&self.ask(&format!("gid {topic}")), 16).unwrap();
        number.to_be_bytes()
    }

    /// Ends it as the kernel does, and waits until it has ended.
    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Kills it and leaves it a zombie.
    pub fn kill_only(&mut self) {
        self.process.kill().unwrap();
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ended_already = self.process.kill();
        let _status = self.process.wait();
    }
}

/// What a node counts of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Own {
    pub taken: u64,
    pub called: u64,
    pub intra: u64,
    pub overwritten: u64,
    pub waiting: u64,
    pub traced: u64,
}
