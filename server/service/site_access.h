// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/access/rights_policy.h"
#include "server/service/rights_verbs.h"
#include "server/store/site_file.h"

namespace cairn {

/// The rights of a site in force, and its audit log. Rights are kept first and are in force then: what the
/// disk does not take has not happened. Used from the service's thread, but for the file, which is used by
/// the tasks handed to `beside` only.
class SiteAccess {
 public:
  using Task = std::function<void()>;
  struct Executors {
    std::function<void(Task)> beside;   ///< one after another, where waiting for the disk holds up nobody
    std::function<void(Task)> service;  ///< on the service's thread, soon
  };
  using Clock = RightsPolicy::Clock;

  /// `folder`: of the store; empty: nothing is kept. `standard`: the rights of a site that has decided
  /// nothing yet. A file that cannot be read is set aside in the folder `damaged`; nobody may do anything
  /// then until an operator has granted it, also after the next start. Errors: kIo, kConfiguration (of a
  /// newer version).
  [[nodiscard]] static Result<std::unique_ptr<SiteAccess>> open(const std::filesystem::path& folder,
                                                                const Rights& standard, Clock clock,
                                                                const Logger& log);
  /// Before anything of what follows.
  void run_by(Executors executors) { executors_ = std::move(executors); }

  [[nodiscard]] const std::shared_ptr<RightsPolicy>& policy() const { return policy_; }
  [[nodiscard]] bool is_kept() const { return file_ != nullptr; }
  /// Why nobody may do anything, for the server's health; empty when all is well.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

  /// Keeps a change and puts it in force; `done` is told on the service's thread. Changes come into force in
  /// their order; each is to be made of the newest rights().
  void put(RightsChange change, std::function<void(const Status& kept)> done);
  /// The newest, in force or about to be.
  [[nodiscard]] const Rights& rights() const { return newest_; }
  /// Writes an entry into the audit log, soon. What the disk does not take is in the server's log only.
  void note(AuditEntry entry);
  /// Error kRefused: nothing is kept.
  void find(AuditQuery query, std::function<void(Result<std::vector<AuditEntry>> found)> done);

  /// Whether a ruling has changed by itself since this was asked last: a grant has expired.
  [[nodiscard]] bool has_expired();

 private:
  SiteAccess(std::shared_ptr<RightsPolicy> policy, std::shared_ptr<SiteFile> file, std::string trouble,
             Logger log)
      : policy_(std::move(policy)),
        newest_(policy_->rights()),
        file_(std::move(file)),
        trouble_(std::move(trouble)),
        log_(std::move(log)),
        next_expiry_(newest_.next_expiry(policy_->now())) {}
  void put_in_force(const Rights& rights);

  std::shared_ptr<RightsPolicy> policy_;
  Rights newest_;
  std::shared_ptr<SiteFile> file_;  ///< used beside only; null: nothing is kept
  std::string trouble_;
  Logger log_;
  Executors executors_;
  std::optional<Timestamp> next_expiry_;
};

}  // namespace cairn
