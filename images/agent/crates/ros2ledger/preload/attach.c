#define _GNU_SOURCE
#include "attach.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

pthread_mutex_t attach_lock = PTHREAD_MUTEX_INITIALIZER;

struct ledger *_Atomic attach_ledger;
_Atomic uint32_t attach_entry = NO_PROCESS;

static char path[PATH_MAX];
static bool refused; /* under the lock: there is no ledger, or no room in it */
/* More than most nodes have endpoints of: each of them costs 32 bytes. */
#define EXIT_HANDLERS 64u
static uint32_t exit_handlers; /* under the lock; a child has its parent's */

void attach_begin(void (*in_child)(void)) {
  const char *named = getenv("BAGPIPE_LEDGER");
  if (named == NULL || strlen(named) >= sizeof path) return;
  strcpy(path, named);
  /* Without it a child would count for its parent: better not at all. */
  if (pthread_atfork(NULL, NULL, in_child) != 0) path[0] = 0;
}

void attach_child(void) {
  pthread_mutex_t fresh = PTHREAD_MUTEX_INITIALIZER;
  attach_lock = fresh;
  atomic_store(&attach_entry, NO_PROCESS);
  refused = false;
}

/* Only memory that nobody can shorten: a shorter one would end this process with SIGBUS. */
static struct ledger *map(void) {
  if (path[0] == 0) return NULL;
  int file = open(path, O_RDWR | O_CLOEXEC);
  if (file < 0) return NULL;
  struct ledger *ledger = NULL;
  int seals = fcntl(file, F_GET_SEALS);
  if (seals >= 0 && (seals & F_SEAL_SHRINK) && lseek(file, 0, SEEK_END) == sizeof *ledger) {
    void *mapped = mmap(NULL, sizeof *ledger, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (mapped != MAP_FAILED) ledger = mapped;
  }
  close(file);
  if (ledger == NULL) return NULL;
  struct ledger_header *header = &ledger->header;
  if (header->magic == LEDGER_MAGIC && header->version == LEDGER_VERSION &&
      header->processes == LEDGER_PROCESSES && header->endpoints == LEDGER_ENDPOINTS)
    return ledger;
  munmap(ledger, sizeof *ledger);
  return NULL;
}

/* What no two programs have in common that one process becomes after the other: when it began and,
 * since exec keeps that, where its stack does. */
struct identity {
  uint64_t start, stack;
};

static uint64_t number(const char **at, int fields) {
  while (*at != NULL && fields-- > 0) *at = strchr(*at + 1, ' ');
  return *at == NULL ? 0 : strtoull(*at + 1, NULL, 10);
}

/* Fields 22 and 28 of /proc/self/stat; 0 if it can't be read, which no process' start is. */
static struct identity identity(void) {
  char text[1024];
  struct identity none = {0, 0};
  int file = open("/proc/self/stat", O_RDONLY | O_CLOEXEC);
  if (file < 0) return none;
  ssize_t length = read(file, text, sizeof text - 1);
  close(file);
  if (length <= 0) return none;
  text[length] = 0;
  const char *at = strrchr(text, ')'); /* the name may have spaces */
  uint64_t start = number(&at, 20);
  return (struct identity){start, number(&at, 6)};
}

/* Called by exit(): once a parent has collected a process, a kernel before Linux 6.15 shows its status to nobody.
 * A child that was made without fork() has its parent's entry, and another number. */
static void note_exit(int status, void *unused) {
  (void)unused;
  uint32_t entry;
  struct ledger *ledger = attached(&entry);
  if (ledger == NULL || ledger->process[entry].pid != (uint32_t)getpid()) return;
  atomic_store(&ledger->process[entry].exit_status, LEDGER_EXITED | ((uint32_t)status & 0xff));
}

/* What was registered last is called first: by one with each endpoint, no destructor or handler that came before
 * that, and may hang, is called before it. */
static void register_note(void) {
  if (exit_handlers < EXIT_HANDLERS && on_exit(note_exit, NULL) == 0) exit_handlers++;
}

/* Takes an entry of the table of processes. A program that was executed has the number and the
 * start time of the one before it, whose endpoints are no more. */
static uint32_t claim_process(struct ledger *ledger) {
  uint32_t pid = (uint32_t)getpid();
  struct identity self = identity();
  uint64_t start = self.start;
  uint32_t mine = NO_PROCESS;
  for (uint32_t entry = 0; start != 0 && entry < LEDGER_PROCESSES; entry++) {
    struct ledger_process *process = &ledger->process[entry];
    uint32_t nobody = 0;
    if (process->pid == pid && process->start == start) {
      atomic_store(&process->state, PROCESS_REPLACED);
    } else if (mine == NO_PROCESS &&
               atomic_compare_exchange_strong(&process->pid, &nobody, pid)) {
      atomic_store(&process->start, start);
      atomic_store(&process->stack, self.stack);
      atomic_store(&process->unlisted_endpoints, 0);
      atomic_store(&process->spinners, 0);
      atomic_store(&process->others_started, 0);
      atomic_store(&process->others_ended, 0);
      atomic_store(&process->machine_timers, 0);
      atomic_store(&process->exit_status, 0);
      atomic_store(&process->state, PROCESS_LIVE);
      mine = entry;
    }
  }
  return mine;
}

bool attach(void (*begin)(void)) {
  if (atomic_load(&attach_entry) != NO_PROCESS) {
    register_note();
    return true;
  }
  if (refused) return false;
  int kept = errno;
  if (atomic_load(&attach_ledger) == NULL) atomic_store(&attach_ledger, map());
  struct ledger *ledger = atomic_load(&attach_ledger);
  uint32_t mine = NO_PROCESS;
  if (ledger != NULL) {
    begin();
    mine = claim_process(ledger);
    if (mine == NO_PROCESS) atomic_fetch_add(&ledger->header.unlisted_processes, 1);
    if (mine != NO_PROCESS) register_note();
  }
  refused = mine == NO_PROCESS;
  atomic_store(&attach_entry, mine);
  errno = kept;
  return !refused;
}

void changed(struct ledger *ledger, enum ledger_event event) {
  struct ledger_header *header = &ledger->header;
  if (atomic_load(&header->wanted[event]) == 0) return;
  if (atomic_exchange(&header->wanted[event], 0) == 0) return;
  atomic_fetch_add(&header->changes, 1);
  syscall(SYS_futex, &header->changes, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}
