//! What `--help` and a wrong command line show.

/// The usage text.
pub(crate) const USAGE: &str = "\
Usage: shape_main -P|-S -t NAME [options]

  -h, --help                       print this text
  -v e|d                           log errors only (e) or more (d); default e
  -P                               publish
  -S                               subscribe
  -d NUMBER                        domain; default 0
  -b                               best effort
  -r                               reliable (default)
  -k NUMBER                        keep the last NUMBER samples, or all: 0
  -f MS                            deadline; default 0: none
  -s NUMBER                        exclusive ownership with this strength; default -1: shared
  -t NAME                          topic
  -c COLOR                         publish this color (default BLUE), or subscribe to it only
  -p NAME                          partition
  -D v|l|t|p                       durability: volatile (default), transient local, transient, persistent
  -x 1|2                           XCDR version; default 1
  -w                               print the samples that are written
  -z NUMBER                        size of the shapes; default 20; 0: grows by one
  -R                               read samples instead of taking them
      --write-period MS            pause of the publisher; default 33
      --read-period MS             pause of the subscriber; default 100
      --time-filter MS             samples of an instance that are closer than this are left out; default 0
      --lifespan MS                samples older than this are worth nothing; default 0: for ever
      --num-iterations NUMBER      end after so many iterations; default 0: never
      --num-instances NUMBER       publish COLOR, COLOR1, COLOR2...; default 1
      --num-topics NUMBER          use NAME, NAME1, NAME2...; default 1
      --final-instance-state u|d   unregister or dispose the instances at the end
      --access-scope i|t|g         presentation: instance (default), topic, group
      --coherent                   presentation: coherent access
      --ordered                    presentation: ordered access
      --coherent-sample-count N    iterations in each coherent set; default 0: no sets
      --additional-payload-size N  octets beside the shape in each sample; default 0
      --take-read                  take or read everything at once, not one instance after the other
      --periodic-announcement MS   period of participant announcements
      --datafrag-size N            octets of a fragment
      --cft EXPRESSION             subscribe to what the content filter passes
      --size-modulo N              with -z 0: sizes go from 1 to N again and again
";
