// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/port_holder.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace cairn::wire::internal {
namespace {

/// "socket:[4711]" of every UDP socket bound to the port.
std::set<std::string> sockets_of(uint16_t port) {
  std::set<std::string> sockets;
  std::ifstream table("/proc/net/udp");
  std::string line;
  std::getline(table, line);  // the heading
  while (std::getline(table, line)) {
    std::istringstream fields(line);
    std::string skipped;
    std::string local;
    std::string inode;
    fields >> skipped >> local;  // sl, then address:port in hexadecimal
    for (int i = 0; i < 8; ++i) fields >> inode;
    const size_t colon = local.find(':');
    if (!fields || colon == std::string::npos) continue;
    if (std::strtoul(local.c_str() + colon + 1, nullptr, 16) == port)
      sockets.insert("socket:[" + inode + "]");
  }
  return sockets;
}

bool has_one_of(const std::filesystem::path& process, const std::set<std::string>& sockets) {
  std::error_code problem;  // it ends, or is another user's
  for (std::filesystem::directory_iterator file(process / "fd", problem), end; !problem && file != end;
       file.increment(problem)) {
    std::error_code unreadable;
    if (sockets.contains(std::filesystem::read_symlink(*file, unreadable).string())) return true;
  }
  return false;
}

std::string name_of(const std::filesystem::path& process) {
  std::ifstream file(process / "comm");
  std::string name;
  std::getline(file, name);
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return c < 0x20 || c >= 0x7f; }, '?');
  return name;
}

}  // namespace

bool port_is_taken(uint16_t port) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return false;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  const bool taken =
      bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 && errno == EADDRINUSE;
  close(fd);
  return taken;
}

std::optional<PortHolder> find_port_holder(uint16_t port) {
  const std::set<std::string> sockets = sockets_of(port);
  if (sockets.empty()) return std::nullopt;
  std::error_code problem;
  for (std::filesystem::directory_iterator process("/proc", problem), end; !problem && process != end;
       process.increment(problem)) {
    const int id = std::atoi(process->path().filename().c_str());
    if (id > 0 && has_one_of(process->path(), sockets)) return PortHolder{name_of(process->path()), id};
  }
  return std::nullopt;
}

}  // namespace cairn::wire::internal
