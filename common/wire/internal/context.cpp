// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/context.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>

#include "common/wire/internal/configuration.h"

namespace cairn::wire::internal {
namespace {

/// The middleware allows a process one domain of each number. On the network the number is ExternalDomainId;
/// inside, each participant of ours has a number of its own, the first free one of this series.
constexpr dds_domainid_t kDomainStride = 1000;
constexpr int kMaxParticipants = 1000;

constexpr std::chrono::minutes kUnfitInterval{1};  ///< a peer that sends rubbish cannot fill the disk

Result<std::pair<Entity, dds_domainid_t>> create_domain(uint32_t first, const std::string& configuration) {
  dds_entity_t created = DDS_RETCODE_PRECONDITION_NOT_MET;
  dds_domainid_t id = first;
  for (int i = 0; i < kMaxParticipants && created == DDS_RETCODE_PRECONDITION_NOT_MET; ++i) {
    id = first + kDomainStride * static_cast<dds_domainid_t>(i);
    created = dds_create_domain(id, configuration.c_str());
  }
  auto domain = checked(created, "DDS domain");
  if (!domain) return tl::unexpected(domain.error());
  return std::pair(*std::move(domain), id);
}

/// Only to say why a server could not start: whether somebody else has its port.
bool port_is_taken(uint16_t port) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return false;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  const bool taken =
      bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 && errno == EADDRINUSE;
  close(fd);
  return taken;
}

Error explain(const ParticipantOptions& options, const Error& error) {
  const uint16_t port = server_port(options.domain);
  if (options.role == Role::kServer && (port_is_taken(port) || port_is_taken(port + 1))) {
    return {ErrorCode::kRefused, "domain " + std::to_string(options.domain) +
                                     " has a server on this host already (UDP port " + std::to_string(port) +
                                     " is taken); stop it or choose another --domain"};
  }
  return {ErrorCode::kConfiguration,
          error.message + " (domain " + std::to_string(options.domain) + ", profile '" + options.profile +
              "'" + (options.listen.empty() ? "" : ", listening on '" + options.listen + "'") +
              "); the lines above say more"};
}

}  // namespace

Result<std::shared_ptr<Context>> Context::create(const ParticipantOptions& options) {
  const Result<std::string> configuration = make_configuration(options);
  if (!configuration) return tl::unexpected(configuration.error());
  auto domain = create_domain(options.domain, *configuration);
  if (!domain) return tl::unexpected(explain(options, domain.error()));
  const dds_entity_t participant = dds_create_participant(domain->second, nullptr, nullptr);
  if (participant < 0) {
    return tl::unexpected(explain(
        options, {ErrorCode::kInternal, std::string("DDS participant: ") + dds_strretcode(-participant)}));
  }
  return std::shared_ptr<Context>(new Context(std::move(domain->first), participant, options.log));
}

Result<dds_entity_t> Context::topic(const TopicDescription& description) {
  const std::lock_guard lock(mutex_);
  if (const auto known = topics_.find(description.name); known != topics_.end()) return known->second;
  const dds_entity_t created =
      dds_create_topic(participant_, description.type, description.name, nullptr, nullptr);
  if (created < 0) {
    return fail(ErrorCode::kInternal,
                std::string("topic ") + description.name + ": " + dds_strretcode(-created));
  }
  topics_.emplace(description.name, created);
  return created;
}

void Context::report_unfit(const char* topic, const std::string& partition, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  const auto [it, is_new] = unfit_.try_emplace(topic);
  Unfit& unfit = it->second;
  if (!is_new && now - unfit.logged_at < kUnfitInterval) {
    ++unfit.passed_over;
    return;
  }
  log_->warn(
      "a {} from partition '{}' is dropped: {}{}", topic, partition, reason,
      unfit.passed_over == 0 ? "" : " (" + std::to_string(unfit.passed_over) + " more since the last line)");
  unfit = {now, 0};
}

}  // namespace cairn::wire::internal
