//! What the kernel's texts say of processors and who has them. Pure: the texts come from
//! elsewhere, and whatever is cut or strange in them is absent, never a panic.

use std::collections::BTreeSet;

/// Clock ticks of some processors, from /proc/stat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Processors {
    pub(crate) number: u64,
    /// User, nice and system time. Interrupts are not in it: nobody's process asked for them.
    pub(crate) used: u64,
    pub(crate) steal: u64,
}

/// Sums up the lines `cpuN` of /proc/stat; only of those in `allowed`, if there are any.
pub(crate) fn processors(stat: &str, allowed: &BTreeSet<u64>) -> Option<Processors> {
    let mut sum = Processors::default();
    for line in stat.lines() {
        let mut words = line.split_ascii_whitespace();
        let number = words.next().and_then(|word| word.strip_prefix("cpu"));
        let Some(Ok(number)) = number.map(str::parse::<u64>) else { continue };
        if !allowed.is_empty() && !allowed.contains(&number) {
            continue;
        }
        let ticks: Vec<u64> = words.map_while(|word| word.parse().ok()).collect();
        let [user, nice, system, _, _, _, _, steal, ..] = ticks[..] else { continue };
        sum.number += 1;
        for part in [user, nice, system] {
            sum.used = sum.used.saturating_add(part);
        }
        sum.steal = sum.steal.saturating_add(steal);
    }
    (sum.number > 0).then_some(sum)
}

/// The processors in `Cpus_allowed_list` of /proc/PID/status, such as `0-3,8`.
pub(crate) fn allowed(status: &str) -> BTreeSet<u64> {
    const MOST: u64 = 1 << 16;
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    let mut found = BTreeSet::new();
    for range in list.unwrap_or_default().trim().split(',') {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        if let (Ok(first), Ok(last)) = (first.parse::<u64>(), last.parse::<u64>()) {
            found.extend(first..=last.min(MOST));
        }
    }
    found
}

/// `some ... total=` of a pressure file, in seconds.
pub(crate) fn pressure(text: &str) -> Option<f64> {
    let some = text.lines().find_map(|line| line.strip_prefix("some "))?;
    let total = some.split_ascii_whitespace().find_map(|word| word.strip_prefix("total="))?;
    Some(total.parse::<u64>().ok()? as f64 / 1e6)
}

/// `throttled_usec` (version 2) or `throttled_time` (version 1) of cpu.stat, in seconds.
pub(crate) fn throttled(text: &str) -> Option<f64> {
    let micro = number_of(text, "throttled_usec").map(|number| number as f64 / 1e6);
    micro.or_else(|| number_of(text, "throttled_time").map(|number| number as f64 / 1e9))
}

/// `usage_usec` of a version 2 cpu.stat, in seconds.
pub(crate) fn usage(text: &str) -> Option<f64> {
    number_of(text, "usage_usec").map(|number| number as f64 / 1e6)
}

fn number_of(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(' '))?;
    line.trim().parse().ok()
}

/// Our own cgroup's folders below /sys/fs/cgroup for the controller `cpu`, the likeliest
/// first, from /proc/self/cgroup. In a container its own folder often is the mount's root,
/// whatever the path says.
pub(crate) fn cgroup_folders(cgroup: &str) -> Vec<String> {
    let mut folders = Vec::new();
    for line in cgroup.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next())
        else {
            continue;
        };
        let path = path.trim_end_matches('/');
        let mount = match controllers {
            "" => String::new(),
            names if names.split(',').any(|name| name == "cpu") => format!("/{names}"),
            _ => continue,
        };
        for folder in [format!("{mount}{path}"), mount] {
            if !folders.contains(&folder) {
                folders.push(folder);
            }
        }
    }
    folders
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn processors_that_are_not_ours_are_left_out() {
        let stat = "cpu  9 9 9 9 9 9 9 9 9 9\ncpu0 1 2 4 8 16 32 64 128 0 0\ncpu1 10 20 40 80 0 0 \
                    0 7 0 0\nintr 5\n";
        let all = Processors { number: 2, used: 77, steal: 135 };
        assert_eq!(processors(stat, &BTreeSet::new()), Some(all));
        let one = Processors { number: 1, used: 70, steal: 7 };
        assert_eq!(processors(stat, &BTreeSet::from([1])), Some(one));
        assert_eq!(processors("cpu 1 2 3", &BTreeSet::new()), None);
        let status = "Name:\tx\nCpus_allowed_list:\t0-2,8\n";
        assert_eq!(allowed(status), BTreeSet::from([0, 1, 2, 8]));
        assert_eq!(allowed("Name:\tx\n"), BTreeSet::new());
    }

    #[test]
    fn pressure_and_throttling_are_seconds_in_both_versions_of_cgroups() {
        let text = "some avg10=69.84 avg60=35.41 avg300=34.06 total=397029873\nfull total=1\n";
        assert_eq!(pressure(text), Some(397.029_873));
        assert_eq!(pressure("full total=1\n"), None);
        let two = "usage_usec 2500000\nnr_throttled 4\nthrottled_usec 1500000\n";
        assert_eq!((throttled(two), usage(two)), (Some(1.5), Some(2.5)));
        let one = "nr_periods 10\nnr_throttled 4\nthrottled_time 250000000\n";
        assert_eq!((throttled(one), usage(one)), (Some(0.25), None));
        assert_eq!(throttled("usage_usec 7\n"), None);
    }

    #[test]
    fn our_cgroup_is_looked_for_where_its_controllers_are_mounted() {
        let hybrid = "3:cpuset:/\n4:cpu,cpuacct:/pod/a\n1:name=systemd:/\n0::/init\n";
        assert_eq!(cgroup_folders(hybrid), ["/cpu,cpuacct/pod/a", "/cpu,cpuacct", "/init", ""]);
        assert_eq!(cgroup_folders("0::/\n"), [""]);
        assert!(cgroup_folders("strange").is_empty());
    }

    proptest! {
        #[test]
        fn no_text_makes_the_readers_panic(text in "(?s).{0,300}") {
            processors(&text, &allowed(&text));
            pressure(&text);
            throttled(&text);
            usage(&text);
            cgroup_folders(&text);
        }
    }
}
