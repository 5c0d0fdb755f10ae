// SPDX-License-Identifier: Apache-2.0
// For LD_PRELOAD with linux.uml 6.1, which keeps the extended registers of a process in 2696 bytes. Where the processor has more of
// them (AMX), the kernel refuses to take back so few (EFAULT), and the guest's first process dies. So they are given back with what
// the processor has besides, all of it in its first state: no program of the guest uses it.
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum {
  kHeader = 512,           // of an XSAVE area: which states it holds
  kHeaderReserved = 520,   // and 56 bytes that must be 0
  kReservedBytes = 56,
  kMostBytes = 65536
};
static const uint64_t kAmxStates = 0x60000;

static long set_extended(pid_t process, struct iovec* given) {
  static __thread unsigned char whole[kMostBytes] __attribute__((aligned(64)));
  struct iovec now = {whole, sizeof whole};
  const long got = syscall(SYS_ptrace, PTRACE_GETREGSET, process, (void*)(long)NT_X86_XSTATE, &now);
  if (got != 0 || now.iov_len <= given->iov_len) {
    return syscall(SYS_ptrace, PTRACE_SETREGSET, process, (void*)(long)NT_X86_XSTATE, given);
  }
  memset(whole, 0, now.iov_len);
  memcpy(whole, given->iov_base, given->iov_len);
  uint64_t states;
  memcpy(&states, whole + kHeader, sizeof states);
  states &= ~kAmxStates;
  memcpy(whole + kHeader, &states, sizeof states);
  memset(whole + kHeaderReserved, 0, kReservedBytes);
  return syscall(SYS_ptrace, PTRACE_SETREGSET, process, (void*)(long)NT_X86_XSTATE, &now);
}

// In place of the C library's.
long ptrace(enum __ptrace_request request, ...) {
  va_list arguments;
  va_start(arguments, request);
  const pid_t process = va_arg(arguments, pid_t);
  void* const address = va_arg(arguments, void*);
  void* const data = va_arg(arguments, void*);
  va_end(arguments);
  if (request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE) return set_extended(process, data);
  if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
    long word = 0;  // these give it back where the system call stores it
    if (syscall(SYS_ptrace, request, process, address, &word) < 0) return -1;
    errno = 0;
    return word;
  }
  return syscall(SYS_ptrace, request, process, address, data);
}
