// SPDX-License-Identifier: Apache-2.0
#include "tests/integration/server_process.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <stdexcept>
#include <string>

#include "tests/integration/test_domain.h"

namespace cairn::testing {

ServerProcess::ServerProcess(int domain) {
  if (domain != 0) {
    // The killed server's socket may linger for a moment.
    if (!eventually([&] { return start(domain); })) throw std::runtime_error("cairn-server does not come up");
    return;
  }
  for (int i = 0; i < 20; ++i) {
    if (start(next_domain())) return;
  }
  throw std::runtime_error("cairn-server starts in no domain");
}

ServerProcess::~ServerProcess() {
  if (pid_ != 0) end(SIGKILL);
}

bool ServerProcess::start(int domain) {
  std::array<int, 2> pipe_ends{};
  if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("pipe");
  const std::string number = std::to_string(domain);
  pid_ = fork();
  if (pid_ == 0) {
    dup2(pipe_ends[1], STDERR_FILENO);
    execl(CAIRN_SERVER_PROGRAM, "cairn-server", "--domain", number.c_str(), "-q", nullptr);
    _exit(127);
  }
  close(pipe_ends[1]);
  std::string said;
  std::array<char, 256> buffer{};
  for (ssize_t n = 0; said.find("ready") == std::string::npos;) {
    n = read(pipe_ends[0], buffer.data(), buffer.size());
    if (n <= 0) break;
    said.append(buffer.data(), static_cast<size_t>(n));
  }
  close(pipe_ends[0]);  // what it says later goes nowhere
  if (said.find("ready") == std::string::npos) {
    end(SIGKILL);
    return false;
  }
  domain_ = domain;
  return true;
}

int ServerProcess::end(int signal) {
  int status = 0;
  kill(pid_, signal);
  waitpid(pid_, &status, 0);
  pid_ = 0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

}  // namespace cairn::testing
