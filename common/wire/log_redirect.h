// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "common/base/log.h"

namespace cairn::wire {

/// While it lives, what the middleware has to say goes to `logger` (warning or error), at most
/// `lines_per_second` and the same line once in ten seconds, with the number of lines passed over in between:
/// a peer that sends rubbish cannot fill the disk (120 000 mutated packets made 98 000 lines), and one that
/// is away does not drown what else there is to say. The middleware has one log per process, so a process has
/// one LogRedirect, owned by main().
class LogRedirect {
 public:
  explicit LogRedirect(Logger logger, int lines_per_second = 10);
  ~LogRedirect();
  LogRedirect(const LogRedirect&) = delete;
  LogRedirect& operator=(const LogRedirect&) = delete;

 private:
  struct Sink;
  std::unique_ptr<Sink> sink_;
};

}  // namespace cairn::wire
