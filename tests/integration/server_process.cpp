// SPDX-License-Identifier: Apache-2.0
#include "tests/integration/server_process.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <stdexcept>
#include <string>
#include <utility>

#include "tests/integration/test_domain.h"

namespace cairn::testing {

ServerProcess::ServerProcess(int domain, std::vector<std::string> arguments)
    : arguments_(std::move(arguments)) {
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
  std::vector<std::string> words{"cairn-server", "--domain", std::to_string(domain), "-q"};
  words.insert(words.end(), arguments_.begin(), arguments_.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_ = fork();
  if (pid_ == 0) {
    dup2(pipe_ends[1], STDERR_FILENO);
    signal(SIGHUP, SIG_DFL);  // the tests may run under nohup
    execv(CAIRN_SERVER_PROGRAM, argv.data());
    _exit(127);
  }
  close(pipe_ends[1]);
  std::string said;
  std::array<char, 256> buffer{};
  for (ssize_t n = 0; said.find(": ready on") == std::string::npos;) {
    n = read(pipe_ends[0], buffer.data(), buffer.size());
    if (n <= 0) break;
    said.append(buffer.data(), static_cast<size_t>(n));
  }
  close(pipe_ends[0]);  // what it says later goes nowhere
  if (said.find(": ready on") == std::string::npos) {
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
