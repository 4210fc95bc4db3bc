"""Messages for rejected broker certificates, with the remedy."""

import ssl
import time

_NOT_YET, _EXPIRED, _NAME, _ADDRESS = 9, 10, 62, 64
"""OpenSSL's X509_V_ERR_CERT_NOT_YET_VALID, _CERT_HAS_EXPIRED, _HOSTNAME_MISMATCH and _IP_ADDRESS_MISMATCH."""
_MAKE = "config/mosquitto/make-certificates.sh"


def certificate_fault(error: ssl.SSLError) -> str:
    """Return what is wrong with the broker's TLS and the remedy, as a part of a sentence."""
    if not isinstance(error, ssl.SSLCertVerificationError):
        return f"{error.reason or error}: does the broker speak TLS on this port?"
    return f"certificate verify failed: {error.verify_message.rstrip('.')}: {_remedy(error.verify_code)}"


def _remedy(code: int) -> str:
    if code in {_NOT_YET, _EXPIRED}:
        today = time.strftime("%Y-%m-%d", time.localtime())
        return f"renew the broker's certificate ({_MAKE}), or set this computer's clock, which says {today}"
    if code in {_NAME, _ADDRESS}:
        return f"use a name that the certificate is for, or make one for this name ({_MAKE})"
    return "is the CA file (--ca-file, or ca_file in the configuration) the one that signed its certificate?"
