// SPDX-License-Identifier: Apache-2.0
#include "common/wire/log_redirect.h"

#include <dds/ddsrt/log.h>

#include <chrono>
#include <mutex>
#include <string>
#include <string_view>

#include "common/wire/internal/known_lines.h"
#include "common/wire/internal/line_fold.h"

namespace cairn::wire {

class LogRedirect::Sink {
 public:
  Sink(Logger to, int limit, std::shared_ptr<RefusedPeers> refused)
      : logger_(std::move(to)), refused_(std::move(refused)), fold_(limit) {}
  ~Sink() { say(fold_.rest()); }
  Sink(const Sink&) = delete;
  Sink& operator=(const Sink&) = delete;

  static void write(void* self, const dds_log_data_t* line) { static_cast<Sink*>(self)->write(*line); }

 private:
  void write(const dds_log_data_t& line) {
    std::string_view text(line.message);
    while (text.ends_with('\n')) text.remove_suffix(1);
    const auto known = internal::known_line(text);
    // Whoever owns the list tells of those in it, in a sentence.
    const bool is_told_elsewhere = refused_ != nullptr && refused_->note(text);
    if (is_told_elsewhere || (known && known->is_harmless)) return logger_->debug("dds: {}", text);
    const bool is_error = (line.priority & (DDS_LC_FATAL | DDS_LC_ERROR)) != 0;
    const std::lock_guard lock(mutex_);
    say(fold_.take(line.file, line.line, {known ? known->words : std::string(text), is_error},
                   std::chrono::steady_clock::now()));
  }

  void say(const std::vector<internal::LineFold::Said>& lines) const {
    for (const auto& line : lines)
      logger_->log(line.is_error ? spdlog::level::err : spdlog::level::warn, "dds: {}", line.text);
  }

  const Logger logger_;
  const std::shared_ptr<RefusedPeers> refused_;
  std::mutex mutex_;
  internal::LineFold fold_;
};

LogRedirect::LogRedirect(Logger logger, int lines_per_second, std::shared_ptr<RefusedPeers> refused)
    : sink_(std::make_unique<Sink>(std::move(logger), lines_per_second, std::move(refused))) {
  dds_set_log_sink(&Sink::write, sink_.get());
}

LogRedirect::~LogRedirect() {
  dds_set_log_sink(nullptr, nullptr);
}

}  // namespace cairn::wire
