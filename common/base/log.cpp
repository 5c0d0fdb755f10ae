// SPDX-License-Identifier: Apache-2.0
#include "common/base/log.h"

#include <spdlog/details/os.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/null_sink.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string>
#include <utility>

#include "common/base/stream_writer.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

/// Lines hold paths, labels and words of peers: none of them may steer the terminal.
class SafeFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) override {
    const std::string text = one_line({message.payload.data(), message.payload.size()});
    spdlog::details::log_msg safe = message;
    safe.payload = text;
    pattern_.format(safe, line);
    message.color_range_start = safe.color_range_start;
    message.color_range_end = safe.color_range_end;
  }

  [[nodiscard]] std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<SafeFormatter>();
  }

 private:
  spdlog::pattern_formatter pattern_{"%H:%M:%S.%e %n: %^%l%$ %v"};
};

constexpr size_t kQueueBytes = size_t{256} << 10;  ///< some thousand lines
/// How long the end of a program waits for somebody who reads its words.
constexpr DrainPatience kLastWords{std::chrono::milliseconds(1'000), std::chrono::milliseconds(5'000)};
constexpr std::string_view kPlain = "\x1b[m";

std::string_view color_of(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::critical:
    case spdlog::level::err:
      return "\x1b[31m\x1b[1m";
    case spdlog::level::warn:
      return "\x1b[33m\x1b[1m";
    case spdlog::level::info:
      return "\x1b[32m";
    default:
      return "\x1b[36m";
  }
}

/// Lines to a stream that may stand still: then lines are left out, and how many is said by the next one that
/// finds room.
class StreamSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  StreamSink(std::unique_ptr<StreamWriter> stream, bool has_color)
      : stream_(std::move(stream)), has_color_(has_color) {}
  ~StreamSink() override { (void)stream_->finish(kLastWords); }
  StreamSink(const StreamSink&) = delete;
  StreamSink& operator=(const StreamSink&) = delete;

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t buffer;
    formatter_->format(message, buffer);
    std::string line(buffer.data(), buffer.size());
    if (has_color_ && message.color_range_end > message.color_range_start) {
      line.insert(message.color_range_end, kPlain);
      line.insert(message.color_range_start, color_of(message.level));
    }
    if (left_out_ > 0)
      line.insert(0, std::to_string(left_out_) + " lines of the log left out: nobody read them\n");
    left_out_ = stream_->write(std::move(line)) ? 0 : left_out_ + 1;
  }
  void flush_() override {}

 private:
  std::unique_ptr<StreamWriter> stream_;
  const bool has_color_;
  size_t left_out_ = 0;
};

}  // namespace

Logger make_logger(const std::string& process_name, int verbosity, int descriptor) {
  const char* no_color = std::getenv("NO_COLOR");
  const bool wants_color = no_color == nullptr || *no_color == '\0';
  const bool has_color = wants_color && isatty(descriptor) == 1 && spdlog::details::os::is_color_terminal();
  auto sink =
      std::make_shared<StreamSink>(StreamWriter::of_descriptor(descriptor, "log", kQueueBytes), has_color);
  auto logger = std::make_shared<spdlog::logger>(process_name, std::move(sink));
  logger->set_formatter(std::make_unique<SafeFormatter>());
  logger->set_level(verbosity < 0   ? spdlog::level::warn
                    : verbosity > 0 ? spdlog::level::debug
                                    : spdlog::level::info);
  return logger;
}

void say_error(std::string_view program, std::string_view message) {
  std::fprintf(stderr, "%s: %s\n", std::string(program).c_str(), one_line(message).c_str());
}

Logger null_logger() {
  return std::make_shared<spdlog::logger>("null", std::make_shared<spdlog::sinks::null_sink_mt>());
}

}  // namespace cairn
