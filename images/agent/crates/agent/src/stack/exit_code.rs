//! How a process ended that is somebody else's child.

use std::os::fd::OwnedFd;
use std::time::Instant;

use rustix::ioctl::{Opcode, Updater, ioctl, opcode};

use crate::stack::processes::Ended;

/// What a process gave exit(3), as it noted itself.
#[derive(Debug, Clone, Copy)]
pub struct Exit {
    pub pid: i32,
    pub began: Instant,
    pub status: Option<i32>,
}

impl Exit {
    /// How it failed, if it did. That it noted 0 does not show how it ended: it may have broken behind that.
    pub fn failure(&self) -> Option<Ended> {
        let failed = self.status.filter(|status| *status != 0);
        failed.map(|_| Ended { exit_status: failed, signal: None })
    }
}

/// How the last program of a process failed that had begun by the time at which it ended.
pub fn failure(exits: &[Exit], pid: i32, at: Instant) -> Option<Ended> {
    let of_it = exits.iter().filter(|exit| exit.pid == pid && exit.began <= at);
    of_it.max_by_key(|exit| (exit.began, exit.status.is_some()))?.failure()
}

/// How a zombie ended, by its line of /proc/PID/stat (proc(5), fields 3 and 52).
pub fn of_zombie(stat: &str) -> Option<Ended> {
    // The command's name stands in parentheses and may hold anything.
    let mut fields = stat.rsplit(')').next()?.split_whitespace();
    if !matches!(fields.next()?, "Z" | "X") {
        return None;
    }
    Some(ended(fields.nth(48)?.parse().ok()?))
}

/// `struct pidfd_info` of linux/pidfd.h, as it was when it had its exit code first.
#[repr(C)]
#[derive(Default)]
struct Info {
    mask: u64,
    cgroup: u64,
    pid: u32,
    thread_group: u32,
    parent: u32,
    owners: [u32; 8],
    exit_code: i32,
}

const GET_INFO: Opcode = opcode::read_write::<Info>(0xff, 11);
/// In `mask`: the exit code is wanted, and is there.
const EXIT: u64 = 1 << 3;

/// How a process ended that its parent has collected, by its pidfd, opened before that; None
/// before Linux 6.15.
#[allow(unsafe_code)] // rustix has no safe wrapper of PIDFD_GET_INFO.
pub fn of_collected(pidfd: &OwnedFd) -> Option<Ended> {
    let mut info = Info { mask: EXIT, ..Info::default() };
    // SAFETY: PIDFD_GET_INFO reads and writes as many bytes as the opcode has as its size, which is
    // that of `Info`, whose fields may have any value.
    unsafe { ioctl(pidfd, Updater::<GET_INFO, Info>::new(&mut info)) }.ok()?;
    (info.mask & EXIT != 0).then(|| ended(info.exit_code))
}

/// What wait(2) makes of a code.
fn ended(code: i32) -> Ended {
    match code & 0x7f {
        0 => Ended { exit_status: Some((code >> 8) & 0xff), signal: None },
        signal => Ended { exit_status: None, signal: Some(signal) },
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::time::Duration;

    use rustix::process::{Pid, PidfdFlags, pidfd_open};

    use super::*;

    #[test]
    fn a_process_failed_by_what_its_last_program_noted_and_no_other_s_number() {
        let zero = Instant::now();
        let exit = |pid, began: u64, status| Exit {
            pid,
            began: zero + Duration::from_secs(began),
            status,
        };
        let exits =
            [exit(7, 1, Some(3)), exit(7, 5, Some(4)), exit(8, 1, Some(0)), exit(9, 1, None)];
        let status = |pid, at| {
            let ended = failure(&exits, pid, zero + Duration::from_secs(at));
            ended.map(|ended| (ended.exit_status, ended.signal))
        };
        assert_eq!(status(7, 0), None);
        assert_eq!(status(7, 4), Some((Some(3), None)));
        assert_eq!(status(7, 5), Some((Some(4), None)));
        assert_eq!([status(8, 9), status(9, 9), status(10, 9)], [None; 3]);
        // A program that became another one by exec has noted nothing.
        let became = [exit(7, 1, Some(3)), exit(7, 1, None)];
        assert!(failure(&became, 7, zero + Duration::from_secs(2)).is_some());
    }

    #[test]
    fn a_zombies_line_says_how_it_ended() {
        let line = |state: &str, code: i32| {
            let between = vec!["0"; 48].join(" ");
            format!("7 (a) b) {state} {between} {code}")
        };
        let ended = |exit_status, signal| Some(Ended { exit_status, signal });
        assert_eq!(of_zombie(&line("Z", 3 << 8)), ended(Some(3), None));
        assert_eq!(of_zombie(&line("Z", 0x80 | 11)), ended(None, Some(11)));
        assert_eq!(of_zombie(&line("Z", 0)), ended(Some(0), None));
        assert_eq!(of_zombie(&line("S", 0)), None);
        assert_eq!(of_zombie(""), None);
    }

    #[test]
    fn a_pidfd_says_how_its_process_ended_once_that_was_collected() {
        let of = |script: &str| {
            let mut child = Command::new("/bin/sh").args(["-c", script]).spawn().unwrap();
            let pidfd = pidfd_open(Pid::from_child(&child), PidfdFlags::empty()).unwrap();
            assert_eq!(of_collected(&pidfd), None);
            child.wait().unwrap();
            of_collected(&pidfd).map(|ended| (ended.exit_status, ended.signal))
        };
        let found = [of("exit 3"), of("exit 0"), of("kill -9 $$")];
        let expected = [(Some(3), None), (Some(0), None), (None, Some(9))];
        // An older kernel keeps it to the parent.
        assert!(found == expected.map(Some) || found == [None; 3], "{found:?}");
    }
}
