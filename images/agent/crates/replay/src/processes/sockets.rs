//! Which of a process's sockets its threads wait at, in one look: a node may have a thousand
//! connections, and a thread for each.

use std::collections::{BTreeMap, BTreeSet};

use super::threads::Waits;
use super::{tasks, waits};

/// What was seen of one process.
pub(crate) struct Sockets {
    /// By which numbers it knows a socket, by the socket's own.
    descriptors: BTreeMap<u32, BTreeSet<u64>>,
    /// At which its threads wait for bytes; `None` where /proc does not say what they do.
    waited_at: Option<BTreeSet<u64>>,
}

impl Sockets {
    /// Looks at a process: first at what it has, then at what its threads do.
    pub(crate) fn of(pid: i32) -> Sockets {
        let descriptors = descriptors(pid);
        let all: Vec<Waits> = tasks(pid).into_iter().filter_map(waits).collect();
        let waited_at = (!all.is_empty()).then(|| {
            let bytes = all.into_iter().filter_map(|waits| match waits {
                Waits::Bytes(descriptor) => Some(descriptor),
                _ => None,
            });
            bytes.collect()
        });
        Sockets { descriptors, waited_at }
    }

    /// Whether a thread waits for bytes of a socket; `None` if that could not be seen.
    pub(crate) fn wait(&self, inode: u32) -> Option<bool> {
        let descriptors = self.descriptors.get(&inode)?;
        Some(!self.waited_at.as_ref()?.is_disjoint(descriptors))
    }
}

fn descriptors(pid: i32) -> BTreeMap<u32, BTreeSet<u64>> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
    let sockets = entries.filter_map(|entry| {
        let target = std::fs::read_link(entry.path()).ok()?;
        Some((inode(target.to_str()?)?, entry.file_name().to_str()?.parse::<u64>().ok()?))
    });
    let mut descriptors: BTreeMap<u32, BTreeSet<u64>> = BTreeMap::new();
    for (inode, descriptor) in sockets {
        descriptors.entry(inode).or_default().insert(descriptor);
    }
    descriptors
}

/// A socket's own number, in what its link in /proc/PID/fd points to.
fn inode(target: &str) -> Option<u32> {
    target.strip_prefix("socket:[")?.strip_suffix(']')?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::{TcpListener, TcpStream};
    use std::sync::mpsc::channel;
    use std::time::{Duration, Instant};

    fn waits_at(inode: u32) -> Option<bool> {
        Sockets::of(i32::try_from(std::process::id()).unwrap()).wait(inode)
    }

    fn inode_of(stream: &TcpStream) -> u32 {
        let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(stream));
        inode(std::fs::read_link(name).unwrap().to_str().unwrap()).unwrap()
    }

    #[test]
    fn a_thread_that_has_gone_back_to_its_socket_is_seen_there() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut far, _) = listener.accept().unwrap();
        let inode = inode_of(&far);
        assert!(waits_at(inode).is_some(), "does this kernel show /proc/PID/syscall?");
        assert_eq!(waits_at(inode), Some(false));
        let (go, wait) = channel::<()>();
        let reader = std::thread::spawn(move || {
            far.read_exact(&mut [0; 1]).unwrap();
            wait.recv().unwrap_err();
            far.read_exact(&mut [0; 1]).unwrap();
        });
        let until = |expected: bool| {
            let begun = Instant::now();
            while waits_at(inode) != Some(expected) {
                assert!(begun.elapsed() < Duration::from_secs(60));
                std::thread::yield_now();
            }
        };
        until(true);
        // It has taken the byte and works on it: on its own wait, it is not at the socket.
        near.write_all(&[1]).unwrap();
        until(false);
        drop(go);
        until(true);
        near.write_all(&[1]).unwrap();
        reader.join().unwrap();
        assert_eq!(waits_at(0), None);
        assert_eq!(Sockets::of(0).wait(inode), None);
    }

    #[test]
    fn each_socket_of_many_has_its_own_thread_in_one_look() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let pairs: Vec<(TcpStream, TcpStream)> = (0..20)
            .map(|_| {
                let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
                (near, listener.accept().unwrap().0)
            })
            .collect();
        assert!(
            waits_at(inode_of(&pairs[0].1)).is_some(),
            "does this kernel show /proc/PID/syscall?"
        );
        // Each by two numbers, of which threads know the first.
        let _twins: Vec<TcpStream> = pairs.iter().map(|pair| pair.1.try_clone().unwrap()).collect();
        let read: Vec<u32> = pairs.iter().step_by(2).map(|(_, far)| inode_of(far)).collect();
        let left: Vec<u32> = pairs.iter().skip(1).step_by(2).map(|(_, f)| inode_of(f)).collect();
        std::thread::scope(|scope| {
            for (_, far) in pairs.iter().step_by(2) {
                scope.spawn(move || (&mut &*far).read_exact(&mut [0; 1]).unwrap());
            }
            let begun = Instant::now();
            loop {
                let look = Sockets::of(i32::try_from(std::process::id()).unwrap());
                assert!(left.iter().all(|inode| look.wait(*inode) == Some(false)));
                if read.iter().all(|inode| look.wait(*inode) == Some(true)) {
                    break;
                }
                assert!(begun.elapsed() < Duration::from_secs(60));
                std::thread::yield_now();
            }
            for (near, _) in pairs.iter().step_by(2) {
                (&mut &*near).write_all(&[1]).unwrap();
            }
        });
    }
}
