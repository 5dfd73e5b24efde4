#pragma once
// Computes SHA-256 hashes with OpenSSL.
#include <openssl/evp.h>

#include <cstddef>
#include <memory>
#include <string>

namespace forceaxis::host {

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), EVP_MD_CTX_free) {
    EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr);
  }

  void update(const void *data, std::size_t bytes) {
    EVP_DigestUpdate(context_.get(), data, bytes);
  }
  // Adds the length of a text and the text, so that the texts ("ab", "c") and ("a", "bc") have
  // different hashes.
  void update(const std::string &text) {
    const std::string length = std::to_string(text.size()) + ":";
    update(length.data(), length.size());
    update(text.data(), text.size());
  }

  // Returns the hash as 64 lower-case hexadecimal digits. No data may be added after this call.
  std::string hex() {
    unsigned char digest[32];
    EVP_DigestFinal_ex(context_.get(), digest, nullptr);
    std::string text;
    for (const unsigned char byte : digest) {
      text += "0123456789abcdef"[byte >> 4];
      text += "0123456789abcdef"[byte & 15];
    }
    return text;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace forceaxis::host
