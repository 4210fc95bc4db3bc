#!/bin/sh
# A lab's own certificates: an authority (CA) that only your computers know, and a certificate for the broker.
#
#   make-certificates.sh FOLDER NAME...
#
#   FOLDER   where they go; made when it is not there. Keep it: the same authority signs the next broker, too
#   NAME...  every name and address under which clients reach the broker: 192.168.0.10 broker.lab localhost
#
#   ca.crt      for every client: ca_file, --ca-file. No secret
#   ca.key      signs. Who has it can pretend to be your broker: it stays in FOLDER and goes to no other computer
#   server.crt  for the broker, server.key too, which is a secret
#
# Again makes a new certificate for the broker, with the same authority: clients need nothing new.
set -eu

CA_DAYS=3650
SERVER_DAYS=825 # then say this again, or clients refuse the broker: "certificate has expired"

refuse() {
    echo "make-certificates: $*" >&2
    exit 2
}
[ $# -ge 2 ] || refuse "say: make-certificates.sh FOLDER NAME..., every name and address of the broker"
command -v openssl > /dev/null || refuse "openssl is not installed: sudo apt install openssl"
folder=$1
shift

# An address is not compared as a name is: the certificate says which of the two each one is.
names=''
for name in "$@"; do
    case $name in
        -* | '' | *[!A-Za-z0-9.:_-]*) refuse "'$name' is no name or address of a computer" ;;
        *:*) kind=IP ;; # IPv6
        *[!0-9.]*) kind=DNS ;;
        *) kind=IP ;;
    esac
    names="$names${names:+,}$kind:$name"
done

umask 077 # keys are for you alone
mkdir -p "$folder"
cd "$folder"

if [ -e ca.key ]; then
    echo "make-certificates: the authority is there already: $folder/ca.key"
else
    openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -noenc -days "$CA_DAYS" \
        -keyout ca.key -out ca.crt -subj "/CN=DAUAM lab authority" \
        -addext "basicConstraints=critical,CA:TRUE,pathlen:0" -addext "keyUsage=critical,keyCertSign,cRLSign"
    chmod 644 ca.crt
    echo "make-certificates: wrote $folder/ca.key and ca.crt"
fi

cat > server.cnf << END
basicConstraints = critical, CA:FALSE
keyUsage = critical, digitalSignature
extendedKeyUsage = serverAuth
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
subjectAltName = $names
END
openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -noenc \
    -keyout server.key -out server.csr -subj "/CN=DAUAM broker"
openssl x509 -req -in server.csr -days "$SERVER_DAYS" -CA ca.crt -CAkey ca.key -CAcreateserial \
    -extfile server.cnf -out server.crt
rm server.csr server.cnf
chmod 644 server.crt
echo "make-certificates: wrote $folder/server.key and server.crt, for $names"
openssl verify -CAfile ca.crt server.crt
