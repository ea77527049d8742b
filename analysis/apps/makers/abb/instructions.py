"""Effects of the instructions and functions of RAPID: the closed list of the dialect.

A name that is neither listed nor defined in the files makes the complete state unknown. Source: ABB, Technical
reference manual, RAPID Instructions, Functions and Data types (3HAC050917), and the application manuals of Arc, Spot,
Continuous Application Platform, Dispense, Paint, Vision and Conveyor tracking.
"""

from __future__ import annotations

import re
from typing import Literal

from analysis.apps.makers.program_machine import OFF
from analysis.apps.makers.program_parser import word_set

Effect = Literal["nothing", "arm", "external", "program", "data by name"]

EFFECTS: dict[Effect, frozenset[str]] = {
    # Signals, waiting, the pendant, files, sockets, interrupts, speeds, loads, world zones, cameras, welding equipment,
    # and storage of paths. Only the arguments can change: a tool, work object or point among them becomes unknown. This
    # is also the effect of conveyor tracking, which moves only the work object it names. Synchronised movements are
    # coordinated only in a work object that another unit moves, whose frame is unknown anyway.
    "nothing": word_set("""
        set reset setdo setao setgo pulsedo invertdo aliasio aliasioreset aliascamera bitclear bitset add incr decr
        clear comment
        waittime waitdi waitdo waituntil waitai waitao waitgi waitgo waitrob waitsynctask waittestandset waitsensor
        waitwobj dropwobj dropsensor recordprofile waitandrecprof storeprofile loadprofile activateprofile
        deactprofile cnvgenreset cnvpredictreach useaccprofile useworkareaprofile
        camflush camgetparameter camgetresult camloadjob camreqimage camsetexposure camsetparameter camsetprogrammode
        camsetrunmode camstartloadjob camwaitloadjob
        tpwrite tperase tpreadfk tpreadnum tpreaddnum tpshow uimsgbox uishow uimsgwrite uimsgwriteabort textget
        texttabinstall
        stop stopmove stopmovereset startmove startmoveretry systemstopaction motionsup resetppmoved resetretrycount
        accset velset speedrefresh speedlimaxis speedlimcheckpoint pathacclim worldacclim pathresol cornerpathwarning
        motionprocessmodeset pathlengthreset pathlengthstart pathlengthstop procerrrecovery pathrecstart pathrecstop
        storepath tuneservo tunereset ditheract ditherdeact fricidinit fricidevaluate fricidsetfriclevels
        resetaxisdistance resetaxismovetime resettorquemargin getjointdata gettorquemargin setupsuperv
        setupcyclicbool removecyclicbool removeallcyclicbool safetycontrollersyncrequest simcollision
        actunit deactunit gripload mechunitload loadid manloadidproc mtoolrotcalib mtooltcpcalib stoolrotcalib
        stooltcpcalib matrixsolve matrixsolveqr matrixsvd
        clkstart clkstop clkreset tryint errwrite errlog errraise bookerrno raise retry trynext raisetouser skipwarn
        readerrdata
        write writebin writestrbin writeanybin writerawbytes readanybin readrawbytes readblock writeblock open close
        rewind opendir closedir clearrawbytes copyrawbytes packrawbytes unpackrawbytes packdnheader cleariobuff copyfile
        renamefile removefile makedir removedir readcfgdata readvararr writevar writevararr swapbytes
        socketcreate socketconnect socketsend socketsendto socketreceive socketreceivefrom socketclose socketbind
        socketlisten socketaccept scwrite rmqemptyqueue rmqfindslot rmqgetmessage rmqgetmsgdata rmqgetmsgheader
        rmqreadwait rmqsendmessage rmqsendwait siconnect siclose sigetcyclic sisetcyclic sendevice
        idelete isleep iwatch ienable idisable ierror isignaldi isignaldo isignalai isignalao isignalgi isignalgo
        itimer ipers ivarvalue ipathpos irmqmessage gettrapdata connect iodisable ioenable iobusstart iobusstate
        acteventbuffer deacteventbuffer syncmoveon syncmoveoff syncmoveundo syncmoveresume syncmovesuspend
        synctosensor supsyncsensoron supsyncsensoroff
        getgroupsignalinfo getsysdata getdataval setdatasearch setsysdata
        triggio triggequip triggint triggcheckio triggrampao triggspeed triggstopproc triggdatareset triggdatacopy
        wzboxdef wzcyldef wzsphdef wzhomejointdef wzlimjointdef wzlimsup wzdoset wzenable wzdisable wzfree
        save erasemodule checkprogref cancelload spystart spystop break testsigndefine testsignreset
        corrcon corrdiscon corrclear corrwrite
        egmreset egmgetid egmsetupuc egmsetupai egmsetupao egmsetupgi egmsetupltapp egmstreamstart egmstreamstop
        egmactpose egmactjoint egmactmove
        arcrefresh arckill arccalc arctracksetup aristone aristoneoff
        stcalib stclose stopen stindgun stindgunreset sttune sttunereset spotrefresh
        capapatrsetup capatrsetup caplatrsetup capcondsetdo capequidist capnoprocess caprefresh capsetstopmode
        capweavesync
        setbrush setbrushfac settmsignal setbrushdo consolidate statesignal
        """),
    # The arm moves, or may be moved, to a place outside the targets of the program.
    "arm": word_set("""
        egmrunpose egmrunjoint egmstop clearpath restopath pathrecmovebwd pathrecmovefwd setleadthrough stcalibmove
        hollowwristreset
        """),
    "external": word_set("moveextj searchextj indamove indcmove inddmove indrmove indreset eoffson eoffsoff eoffsset"),
    # Another program may be loaded, selected or run, or the configuration of the controller may change.
    "program": word_set("""
        load startload waitload unload callbyvar warmstart writecfgdata savecfgdata
        """),
    "data by name": word_set("setdataval setalldataval"),
}

EFFECT: dict[str, Effect] = {name: effect for effect, names in EFFECTS.items() for name in names}

SWITCHES: dict[str, tuple[str, str]] = {
    "pdispon": ("shift", "on"), "pdispset": ("shift", "on"), "pdispoff": ("shift", "off"),
    "softact": ("tracking", "on"), "softdeact": ("tracking", "off"),
}  # fmt: skip
SETTINGS = {
    "confl": ("conf l", "off", "on", "off"),
    "confj": ("conf j", "off", "on", "off"),
    "singarea": ("switch", "lockaxis4", OFF, "on"),
    "cirpathmode": ("switch arcs", r"wrist\d\d", OFF, "on"),
}
"""Instructions that set a state variable by a switch among their arguments: the value without and with it."""

MOVE = re.compile(
    r"(?:move(?P<move>absj|j|l|c)(?:do|ao|go|sync)?|trigg(?P<trigg>absj|j|l|c)(?:ios)?|"
    r"arc(?:move)?(?P<arc>absj|j|l|c)\d?(?:start|end)?\d?|spotm?(?P<spot>l|j)|"
    r"(?:cap|disp|glue|paint|nut)(?P<process>l|j|c)|search(?P<search>l|c)|contact(?P<contact>l)|"
    r"egmmove(?P<egm>l|c))"
)
"""Moves to one point, or to a via point and an end point (C). Their last argument is the tool."""
TOOL_THIRD = re.compile(r"move(?:j|l|c)(?:do|ao|go|sync)")
"""Moves with more arguments after the tool."""

FUNCTIONS = word_set("""
    offs reltool crobt cjointt cpos ctool cwobj calcrobt calcjointt posemult poseinv posevect defframe defdframe
    defaccframe orobt mirpos orientzyx eulerzyx norient distance dotprod vectmagn crossprod
    abs absdnum acos acosdnum asin asindnum atan atandnum atan2 atan2dnum cos cosdnum sin sindnum tan tandnum exp pow
    powdnum sqrt sqrtdnum round rounddnum trunc truncdnum max min bitand bitanddnum bitor bitordnum bitxor bitxordnum
    bitneg bitnegdnum bitlsh bitlshdnum bitrsh bitrshdnum bitcheck bitcheckdnum
    numtodnum dnumtonum valtostr numtostr dnumtostr strtoval strtobyte bytetostr strlen strfind strmap strmatch strmemb
    strorder strpart strformat decstrtohex hexstrtodec strdigcalc strdigcmp type ctime cdate clkread gettime
    getservicetime dim present testdi doutput diinput goutput aoutput aointput ginput ginputdnum goutputdnum ainput
    aintput dinput getsignalorigin validio iounitstate iobusstate isfile filesize fssize filetime filetimednum readnum
    readstr readbin readstrbin readdir opendir readvar
    uimessagebox uinumentry uinumtune uialphaentry uilistview uidnumentry uidnumtune uiclientexist
    socketgetstatus socketpeek rmqgetslotname opmode runmode robos roboname robname gettaskname getmecunitname
    getnextmechunit ismechunitactive isstopmoveact isstopstateevent isleadthrough nonmotionmode ppmovedinmanmode
    execlevel execevent eventtype errorinfo pfrestart cspeedoverride maxrobspeed motionplannerno pathlevel
    pathlengthget pathrecvalidbwd pathrecvalidfwd paridposvalid paridrobvalid getmodalpayloadmode getmotortorque
    getaxisdistance getaxismovetime indinpos indspeed taskruns taskrunmec taskrunrob taskisactive taskisexecuting
    taskinsync tasksinsync rawbyteslen ispers isvar issysid getsysinfo testandset triggdatavalid testsignread
    unpackrawbytes egmgetstate modexist modtime progmemfree getsysdata getnextsym getnextcyclicbool
    getnumberofcyclicbool gettspstatus getuasusername corrread textget
    camgetexposure camgetloadedjob camgetname camnumberofresults camgetmode
    stcalcforce stcalctorque stiscalib stisclosed stisindgun stisopen
    matrixinverse matrixtranspose
    ipers and or xor not if then elseif while for case test return from to step do
    """)
"""Functions of RAPID without side effects, and keywords that can precede a bracket."""
WRITES = word_set("""
    strtoval unpackrawbytes testandset readrawbytes defaccframe getnextmechunit getsysdata getsysinfo readstrbin readstr
    readnum readbin readvar uimessagebox uinumentry uinumtune uialphaentry uilistview uidnumentry uidnumtune egmgetstate
    getnextsym getnextcyclicbool readdir
    """)
"""Functions that write to their arguments, always or through an optional argument."""
