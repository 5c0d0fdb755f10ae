// SPDX-License-Identifier: Apache-2.0
#include "common/wire/log_redirect.h"

#include <dds/ddsrt/log.h>

#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

namespace cairn::wire {

struct LogRedirect::Sink {
  Sink(Logger to, int limit) : logger(std::move(to)), lines_per_second(limit) {}

  const Logger logger;
  const int lines_per_second;
  std::mutex mutex;
  std::chrono::steady_clock::time_point window_start{};
  int lines = 0;        ///< in this window
  int passed_over = 0;  ///< since the last line that was let through
  static constexpr std::chrono::seconds kSameLine{10};
  static constexpr size_t kLinesRemembered = 32;
  std::map<std::string, std::chrono::steady_clock::time_point, std::less<>> said;  ///< and when

  static void write(void* self, const dds_log_data_t* line) { static_cast<Sink*>(self)->write(*line); }

  void write(const dds_log_data_t& line) {
    std::string_view text(line.message);
    while (text.ends_with('\n')) text.remove_suffix(1);
    std::string suffix;
    {
      const std::lock_guard lock(mutex);
      const auto now = std::chrono::steady_clock::now();
      if (now - window_start >= std::chrono::seconds(1)) {
        window_start = now;
        lines = 0;
      }
      const auto before = said.find(text);
      const bool is_repeated = before != said.end() && now - before->second < kSameLine;
      if (is_repeated || ++lines > lines_per_second) {
        ++passed_over;
        return;
      }
      if (before == said.end() && said.size() == kLinesRemembered) said.clear();
      said.insert_or_assign(std::string(text), now);
      if (passed_over > 0) suffix = " (" + std::to_string(passed_over) + " lines passed over)";
      passed_over = 0;
    }
    const bool error = (line.priority & (DDS_LC_FATAL | DDS_LC_ERROR)) != 0;
    logger->log(error ? spdlog::level::err : spdlog::level::warn, "dds: {}{}", text, suffix);
  }
};

LogRedirect::LogRedirect(Logger logger, int lines_per_second)
    : sink_(std::make_unique<Sink>(std::move(logger), lines_per_second)) {
  dds_set_log_sink(&Sink::write, sink_.get());
}

LogRedirect::~LogRedirect() {
  dds_set_log_sink(nullptr, nullptr);
}

}  // namespace cairn::wire
