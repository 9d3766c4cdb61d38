//! Which processes there are, who started them, and what they have used.

use std::collections::{BTreeMap, BTreeSet};

/// A process's line of /proc/PID/stat (proc(5)).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ProcessLine {
    pub(crate) parent: i32,
    /// User and system time, in clock ticks.
    pub(crate) ticks: u64,
    /// The same of the children that it has waited for, and of theirs.
    pub(crate) reaped: u64,
}

/// Every process that /proc shows.
pub(crate) fn processes() -> BTreeMap<i32, ProcessLine> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let line = |entry: std::fs::DirEntry| {
        let pid: i32 = entry.file_name().to_str()?.parse().ok()?;
        let stat = std::fs::read(entry.path().join("stat")).ok()?;
        Some((pid, process_line(&String::from_utf8_lossy(&stat))?))
    };
    entries.filter_map(line).collect()
}

/// Reads a line of /proc/PID/stat.
fn process_line(stat: &str) -> Option<ProcessLine> {
    // The command's name stands in parentheses and may hold anything.
    let (_, after) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = after.split_ascii_whitespace().collect();
    let ticks = |at: usize| fields.get(at)?.parse::<u64>().ok();
    Some(ProcessLine {
        parent: fields.get(1)?.parse().ok()?,
        ticks: ticks(11)?.saturating_add(ticks(12)?),
        reaped: ticks(13)?.saturating_add(ticks(14)?),
    })
}

/// Every process below `root`, without `spared` and what is below those.
pub fn descendants(root: u32, spared: &BTreeSet<i32>) -> BTreeSet<i32> {
    below(&processes(), &[i32::try_from(root).unwrap_or(0)], spared)
}

/// Of the processes below `root` those that have started no other which is there.
pub(crate) fn leaves(root: u32) -> BTreeSet<i32> {
    let processes = processes();
    let mut found = below(&processes, &[i32::try_from(root).unwrap_or(0)], &BTreeSet::new());
    for line in processes.values() {
        found.remove(&line.parent);
    }
    found
}

/// Of these processes those below `roots`, without `spared` and what is below those.
pub(crate) fn below(
    processes: &BTreeMap<i32, ProcessLine>,
    roots: &[i32],
    spared: &BTreeSet<i32>,
) -> BTreeSet<i32> {
    let mut children: BTreeMap<i32, Vec<i32>> = BTreeMap::new();
    for (pid, line) in processes {
        children.entry(line.parent).or_default().push(*pid);
    }
    let mut found = BTreeSet::new();
    let mut unseen = roots.to_vec();
    while let Some(parent) = unseen.pop() {
        for pid in children.get(&parent).into_iter().flatten() {
            if !spared.contains(pid) && found.insert(*pid) {
                unseen.push(*pid);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_process_s_line_is_read_by_its_fields_whatever_its_name() {
        let stat = "7 (a) b) c) S 3 7 7 0 -1 4194560 10 20 30 40 111 222 333 444 20 0 1 0 5";
        let line = ProcessLine { parent: 3, ticks: 333, reaped: 777 };
        assert_eq!(process_line(stat), Some(line));
        assert_eq!(process_line("7 (a) S 3"), None);
    }

    #[test]
    fn who_has_started_another_one_is_no_leaf() {
        let mut shell = std::process::Command::new("sh");
        let mut shell = shell.args(["-c", "sleep 600 & wait"]).spawn().unwrap();
        let until = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while descendants(shell.id(), &BTreeSet::new()).is_empty() {
            assert!(std::time::Instant::now() < until);
            std::thread::yield_now();
        }
        let (ours, below) = (leaves(std::process::id()), leaves(shell.id()));
        let pid = shell.id() as i32;
        shell.kill().unwrap();
        shell.wait().unwrap();
        assert_eq!(below.len(), 1);
        assert!(below.is_subset(&ours) && !ours.contains(&pid));
        let one = below.first().unwrap().to_string();
        std::process::Command::new("kill").arg(one).status().unwrap();
    }

    proptest! {
        #[test]
        fn no_line_makes_the_reader_panic(text in "(?s).{0,300}") {
            process_line(&text);
        }

        #[test]
        fn what_the_kernel_writes_is_what_is_read(
            name in "[^\\n]{0,15}", parent in 0..i32::MAX, ticks in prop::array::uniform4(0..1u64 << 60),
        ) {
            let [user, system, reaped_user, reaped_system] = ticks;
            let stat = format!(
                "7 ({name}) S {parent} 7 7 0 -1 1 2 3 4 5 {user} {system} {reaped_user} \
                 {reaped_system} 20 0 1 0"
            );
            let line = process_line(&stat).unwrap();
            prop_assert_eq!(line.parent, parent);
            prop_assert_eq!(line.ticks, user + system);
            prop_assert_eq!(line.reaped, reaped_user + reaped_system);
        }
    }
}
