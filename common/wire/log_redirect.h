// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "common/base/log.h"
#include "common/wire/refused_peers.h"

namespace cairn::wire {

/// While it lives, what the middleware has to say goes to `logger` (warning or error), in plain words where
/// it is known what a line means (internal/known_lines.h), what is harmless at level debug; folded: of one
/// kind of line (from one place in the middleware) three in ten seconds, the same line once, and "… and 79
/// more like it" with the next line of any kind or at the end. In all at most `lines_per_second`. So a cut
/// cable, whose lines name every peer and port, is told in a few lines, and a peer that sends rubbish cannot
/// fill the disk (120 000 mutated packets made 98 000 lines). The middleware has one log per process, so a
/// process has one LogRedirect, owned by main().
class LogRedirect {
 public:
  /// `refused`: who was not let into a secured site is noted there, and logged here at level debug only;
  /// null: such lines are like all others.
  explicit LogRedirect(Logger logger, int lines_per_second = 10,
                       std::shared_ptr<RefusedPeers> refused = nullptr);
  ~LogRedirect();
  LogRedirect(const LogRedirect&) = delete;
  LogRedirect& operator=(const LogRedirect&) = delete;

 private:
  class Sink;
  std::unique_ptr<Sink> sink_;
};

}  // namespace cairn::wire
