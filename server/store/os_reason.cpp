// SPDX-License-Identifier: Apache-2.0
#include "server/store/os_reason.h"

#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "server/store/database_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

std::string why_no_access(const fs::path& path) {
  return ::access(path.c_str(), W_OK) == 0 ? std::string() : std::strerror(errno);
}

/// A file as /proc/locks names it: device and inode.
std::string lock_name(const fs::path& path) {
  struct stat file {};
  if (::stat(path.c_str(), &file) != 0) return {};
  char text[64];
  std::snprintf(text, sizeof(text), "%02x:%02x:%lu", major(file.st_dev), minor(file.st_dev),
                static_cast<unsigned long>(file.st_ino));
  return text;
}

std::string name_of_process(long process) {
  std::ifstream in("/proc/" + std::to_string(process) + "/comm");
  std::string name;
  std::getline(in, name);
  return (name.empty() ? "a program" : name) + " (process " + std::to_string(process) + ")";
}

}  // namespace

std::string why_not_writable(const fs::path& file) {
  if (is_there(file)) {
    if (std::string why = why_no_access(file); !why.empty()) return why;
  }
  if (std::string why = why_no_access(file.parent_path()); !why.empty()) return why;  // logs lie beside it
  struct statvfs space {};
  const bool full = ::statvfs(file.parent_path().c_str(), &space) == 0 && space.f_bavail == 0;
  return full ? std::strerror(ENOSPC) : "";
}

std::string holder_of_lock(const fs::path& database) {
  // Locks of a database with a log are on its "-shm".
  const std::string names[] = {lock_name(database.string() + "-shm"), lock_name(database)};
  std::ifstream locks("/proc/locks");
  std::string reader;
  for (std::string line; std::getline(locks, line);) {
    // "1: POSIX  ADVISORY  WRITE 4711 fe:00:1234 120 120"
    std::istringstream in(line);
    std::string number, kind, mode, access, file;
    long process = 0;
    if (!(in >> number >> kind >> mode >> access >> process >> file)) continue;
    if (process <= 0 || process == ::getpid() || (file != names[0] && file != names[1])) continue;
    if (access == "WRITE") return name_of_process(process);
    reader = name_of_process(process);
  }
  return reader;
}

}  // namespace cairn
