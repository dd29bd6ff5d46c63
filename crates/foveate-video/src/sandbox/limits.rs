//! What the kernel still grants to a decoder: memory up to a limit, time, and the files that are open.

/// Whether this system has such limits.
pub(super) const SUPPORTED: bool = true;

/// Gives up everything but reading and writing open files, up to `memory` more bytes, and `seconds` of processor time: for all threads
/// of this process, and permanently.
///
/// # Errors
/// The kernel refuses, in words.
pub(super) fn enter(memory: u64, seconds: u64) -> Result<(), String> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

    let refused = |error: &dyn std::fmt::Display| format!("the kernel refuses the sandbox ({error})");
    let mapped = std::fs::read_to_string("/proc/self/statm").map_err(|error| refused(&error))?;
    let pages = mapped.split(' ').next().and_then(|pages| pages.parse::<u64>().ok()).unwrap_or(0);
    let space = pages.saturating_mul(rustix::param::page_size() as u64).saturating_add(memory);
    for (resource, most) in [
        (Resource::As, space),
        (Resource::Cpu, seconds),
        (Resource::Core, 0),
        (Resource::Fsize, 0),
        (Resource::Nofile, 0),
    ] {
        let most = Some(getrlimit(resource).maximum.map_or(most, |now| now.min(most)));
        setrlimit(resource, Rlimit { current: most, maximum: most }).map_err(|error| refused(&error))?;
    }
    seccompiler::apply_filter_all_threads(&filter()?).map_err(|error| refused(&error))
}

/// The system calls that stay: those of memory, clocks, open files, and of the end. All others return EPERM: without them there are no
/// files, sockets, programs, processes or threads. No memory becomes executable.
fn filter() -> Result<seccompiler::BpfProgram, String> {
    use seccompiler::{SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter, SeccompRule};

    const EPERM: u32 = libc::EPERM as u32;
    let free = [
        libc::SYS_read,
        libc::SYS_write,
        libc::SYS_writev,
        libc::SYS_lseek,
        libc::SYS_close,
        libc::SYS_brk,
        libc::SYS_munmap,
        libc::SYS_mremap,
        libc::SYS_madvise,
        libc::SYS_futex,
        libc::SYS_clock_gettime,
        libc::SYS_getrandom,
        libc::SYS_sched_yield,
        libc::SYS_sigaltstack,
        libc::SYS_rt_sigprocmask,
        libc::SYS_rt_sigreturn,
        libc::SYS_restart_syscall,
        libc::SYS_exit,
        libc::SYS_exit_group,
    ];
    let words = |error: seccompiler::BackendError| error.to_string();
    let code = u64::try_from(libc::PROT_EXEC).expect("a positive flag");
    let mut rules: std::collections::BTreeMap<_, _> = free.map(|call| (call, vec![])).into();
    for call in [libc::SYS_mmap, libc::SYS_mprotect] {
        let data = SeccompCondition::new(2, SeccompCmpArgLen::Dword, SeccompCmpOp::MaskedEq(code), 0).map_err(words)?;
        rules.insert(call, vec![SeccompRule::new(vec![data]).map_err(words)?]);
    }
    let arch = std::env::consts::ARCH.try_into().map_err(words)?;
    let filter = SeccompFilter::new(rules, SeccompAction::Errno(EPERM), SeccompAction::Allow, arch).map_err(words)?;
    filter.try_into().map_err(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{ErrorKind, Read};

    /// A thread under the filter alone, without the limits, which hold for the process.
    #[test]
    fn files_sockets_programs_and_threads_are_refused() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("bound");
        let mut open = std::fs::File::open("/proc/self/status").expect("a file");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new");
        let work = move || {
            seccompiler::apply_filter(&filter().expect("a program")).expect("a kernel with seccomp");
            let refused = |what: &str, result: std::io::Result<()>| {
                assert_eq!(result.expect_err(what).kind(), ErrorKind::PermissionDenied, "{what}");
            };
            refused("reading", std::fs::File::open("/etc/passwd").map(drop));
            refused("creating", std::fs::File::create(&path).map(drop));
            refused("listing", std::fs::read_dir("/").map(drop));
            refused("deleting", std::fs::remove_file("/proc/self/status"));
            refused("connecting", std::net::TcpStream::connect(address).map(drop));
            refused("sending", std::net::UdpSocket::bind("127.0.0.1:0").map(drop));
            refused("a local socket", std::os::unix::net::UnixStream::pair().map(drop));
            refused("a program", std::process::Command::new("/bin/true").status().map(drop));
            refused("a thread", std::thread::Builder::new().spawn(|| ()).map(drop));
            // An open file can still be read.
            let mut text = String::new();
            open.read_to_string(&mut text).expect("an open file");
            text
        };
        let text = std::thread::spawn(work).join().expect("all refused");
        assert!(text.contains("Name:"));
        assert!(!folder.path().join("new").exists());
    }
}
