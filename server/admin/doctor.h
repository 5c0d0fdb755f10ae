// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "server/admin/admin_client.h"
#include "server/admin/store_commands.h"

namespace cairn {

/// The result of a look at one thing.
struct Finding {
  enum class Grade { kOk, kWarning, kProblem };
  std::string what;  ///< "ports"
  Grade grade = Grade::kOk;
  std::string detail;
  std::string remedy;  ///< where it is not ok
};

// Each judges what was read of the system, which is handed in: a test can be ill at will.

/// `range`: /proc/sys/net/ipv4/ip_local_port_range; `reserved`: ip_local_reserved_ports beside it.
[[nodiscard]] Finding judge_ports(const std::string& range, const std::string& reserved, int domain);
/// `most`: /proc/sys/net/core/rmem_max.
[[nodiscard]] Finding judge_buffers(const std::string& most);
[[nodiscard]] Finding judge_disk(const std::string& folder, uint64_t free_bytes, uint64_t all_bytes,
                                 bool is_writable);

/// The words of `cairnctl doctor`; `connection`: once the line has been read.
void describe_doctor(CLI::App* app, const AdminClientOptions* connection, LocalAction* local);

}  // namespace cairn
