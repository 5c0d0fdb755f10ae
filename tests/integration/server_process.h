// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace cairn::testing {

/// The cairn-server program as a child process, to be killed.
class ServerProcess {
 public:
  /// Starts in `domain` (0: any free one) and returns when it says that it is ready; throws otherwise.
  /// `arguments` are its own beside the domain.
  explicit ServerProcess(int domain = 0, std::vector<std::string> arguments = {});
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  [[nodiscard]] int domain() const { return domain_; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  /// Sends a signal and waits for the end; the exit code, or minus the signal that ended it.
  int end(int signal);

 private:
  /// False when it ends before it is ready.
  [[nodiscard]] bool start(int domain);
  const std::vector<std::string> arguments_;
  pid_t pid_ = 0;
  int domain_ = 0;
};

}  // namespace cairn::testing
